"""Pages say what is so: their commands are understood, their links lead somewhere."""

import os
import re
import shlex
from contextlib import redirect_stderr, redirect_stdout
from importlib.util import find_spec
from io import StringIO
from pathlib import Path

import click
import pytest

from zwidth import cli
from zwidth.cli import COMMANDS, zwidth
from zwidth.errors import Status

ROOT = Path(__file__).parents[1]
if not (ROOT / "mkdocs.yml").is_file():
    pytest.skip("not a clone: the wheel has no documentation", allow_module_level=True)
PAGES = sorted(
    p
    for p in (
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "benchmarks").rglob("*.md"),
    )
)
MOST_WORDS = 40_000  # of the pages that people write for users; docs/reference is made by code
# A command stands on a line of its own in a block, or whole between backticks.
IN_BLOCK = re.compile(r"^(?:    |\t)?(?:\$ )?(?:\.venv/bin/)?(zwidth .+)$", re.MULTILINE)
IN_LINE = re.compile(r"`(zwidth [^`]+)`")
MODULE = re.compile(r"python -m (benchmarks(?:\.\w+)+)")
LINK = re.compile(r"\]\(([^)\s]+)\)")
# Of a command, or an option of it, that is only named; of a file that an earlier command writes.
NO_FAULT = ("argument DEVICE is missing", "requires an argument", "does not exist")
# What stands for a word of the reader's: DEVICE.toml, FILE, N, and [--optional parts].
OPTIONAL = re.compile(r"\[[^\]]*\]")


def blocks(text: str) -> str:
    """The lines of a page that are shown as code: fenced, or indented by four."""
    shown: list[str] = []
    fenced = False
    for line in text.splitlines():
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif fenced or line.startswith("    "):
            shown.append(line)
    return "\n".join(shown).replace("\\\n", " ")


def commands(text: str) -> list[str]:
    """The commands of zwidth that a page shows, each as a shell would read it."""
    alone = IN_BLOCK.findall(blocks(text))
    found = [part.strip() for line in (*alone, *IN_LINE.findall(text)) for part in line.split("&&")]
    return [line.split(" > ")[0].split(" | ")[0].split(" #")[0] for line in found]


def fault(line: str) -> str:
    """What is wrong with a command as a page writes it, "" where it is understood."""
    try:
        program, *words = shlex.split(OPTIONAL.sub("", line))
    except ValueError as error:
        return str(error)
    if program != "zwidth" or not words or words[0].startswith("-") or words[0].isupper():
        return ""
    if words[0] not in COMMANDS:
        return f"there is no command {words[0]!r}"
    command = zwidth.get_command(click.Context(zwidth), words[0])
    assert command is not None
    options = {flag: o for o in command.params for flag in (*o.opts, *o.secondary_opts)}
    for word in words[1:]:
        flag = word.split("=")[0]
        if flag.startswith("--") and flag not in options and flag != "--help":
            return f"{words[0]} has no option {flag}"
    if "..." in line or re.search(r"\b[A-Z]{2,}\b", line):  # words that stand for others
        return ""
    try:
        command.make_context(words[0], words[1:])
    except click.exceptions.MissingParameter:
        return ""  # a command that is only named
    except (click.ClickException, ValueError) as error:
        said = str(getattr(error, "message", error))
        return "" if any(part in said for part in NO_FAULT) else said
    return ""


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_of_pages_are_understood(page: Path):
    """Mutation: an option renamed in the program and not on a page."""
    text = page.read_text(encoding="utf-8")
    wrong = [f"{line}: {said}" for line in commands(text) if (said := fault(line))]
    wrong += [f"no module {name}" for name in MODULE.findall(text) if find_spec(name) is None]
    assert wrong == []


# Commands that take less than two seconds each; others are only parsed.
CHEAP = ("devices", "effects", "convert", "export")
# What a page leaves to its reader: a file of his, or an effect that he wrote.
NOT_HERE = re.compile(
    r"DEVICE is missing|does not exist|no (such )?file|neither a file nor|is not a file"
    r"|there is no effect"
    r"|missing argument|requires an argument",
    re.IGNORECASE,
)


def run_in(folder: Path, line: str) -> str:
    """What a cheap command says when it fails in a folder, "" where it runs or is not for here."""
    words = shlex.split(line)
    if words[1:2] == [] or words[1] not in CHEAP or re.search(r"[\[{]|\.\.\.|\b[A-Z]{2,}\b", line):
        return ""
    here = Path.cwd()
    os.chdir(folder)
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as errors:
            status = cli.run(words[1:])
    finally:
        os.chdir(here)
    said = " ".join(errors.getvalue().split())
    return "" if status == Status.DONE or NOT_HERE.search(said) else said or str(status)


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A folder with the sample where pages have it, and as the reader's own data.csv."""
    sample = ROOT / "docs" / "sample" / "bench.csv"
    for file in (tmp_path / "docs" / "sample" / sample.name, tmp_path / "data.csv"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(sample.read_bytes())
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_cheap_commands_of_pages_run(page: Path, bench: Path):
    """In the order of the page. Mutation: an exporter that a page names refuses its device."""
    lines = [c for c in commands(page.read_text(encoding="utf-8")) if not fault(c)]
    assert [f"{line}: {said}" for line in lines if (said := run_in(bench, line))] == []


def test_a_command_that_fails_is_seen(bench: Path):
    """The test above is able to fail: a format that the sample cannot become."""
    assert "data.pdf" in run_in(bench, "zwidth convert data.csv data.pdf")
    assert run_in(bench, "zwidth convert data.csv") == ""
    assert run_in(bench, "zwidth convert yours.csv") == ""


def test_a_command_that_is_not_understood_is_seen():
    """The test above is able to fail."""
    page = "Say `zwidth boundry x`.\n\n    zwidth boundary phantom_1_0 --dely-ms 2\n"
    one, two = commands(page)
    assert "no option --dely-ms" in fault(one)
    assert "no command 'boundry'" in fault(two)
    assert "not allowed" in fault("zwidth boundary phantom_1_0 --delay-ms -2")
    assert fault("zwidth boundary phantom_1_0 --delay-ms 2 4") == ""


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_of_pages_lead_to_files(page: Path):
    """Also out of the documentation, where mkdocs does not look. Mutation: a page moved."""
    text = page.read_text(encoding="utf-8")
    targets = [t.partition("#")[0] for t in LINK.findall(text) if "://" not in t]
    assert [t for t in targets if t and not (page.parent / t).exists()] == []


def test_pages_for_users_stay_few():
    """Mutation: a laboratory notebook moved back."""
    pages = [p for p in PAGES if (ROOT / "docs") in p.parents and "reference" not in p.parts]
    assert sum(len(p.read_text(encoding="utf-8").split()) for p in pages) < MOST_WORDS


# A figure that several pages give: where, and what stands about it. All must be the same number.
SAME: dict[str, tuple[tuple[str, str], ...]] = {
    "recordings of the set": (
        ("README.md", r"tested on (\d+) simulated recordings"),
        ("docs/evidence.md", r"## (\d+) recordings that no search"),
    ),
    "nothing hidden, nothing claimed": (
        ("README.md", r"claimed nothing \((\d+) of"),
        ("docs/evidence.md", r"\| nothing \| (\d+) \|"),
    ),
    "answers called identified": (
        ("README.md", r"Of\s+its\s+(\d+)\s+answers\s+with\s+the\s+verdict\s+`identified`,"),
        ("docs/evidence.md", r"Of\s+(\d+)\s+answers\s+with\s+`identified`,\s+one"),
    ),
    "intervals that contain the truth": (
        ("docs/evidence.md", r"contain\s+the\s+truth\s+for\s+(\d+ of \d+)\s+effects"),
        ("docs/tutorial.md", r"test\]\(evidence.md\),\s+(\d+ of \d+)\s+intervals"),
    ),
    "compiling for a boundary": (
        ("docs/performance.md", r"compiling for a boundary \| (.+?) of processor time"),
        ("docs/install.md", r"the first\s+boundary for\s+(\d+ s)\."),
    ),
    "compiling for a diagnosis": (
        ("docs/performance.md", r"README's first line: install; .*? s; (\d+ s); "),
        ("docs/install.md", r"first diagnosis compiles for\s+(\d+ s) \(two processes\)"),
        ("docs/check.md", r"compiles the simulation in (\d+ s) on"),
    ),
    "a verdict of a log that grows": (
        ("docs/performance.md", r"after the newest sample \| ([\d.]+ s)"),
        ("docs/watch.md", r"was reported ([\d.]+ s) after the newest sample"),
        ("benchmarks/notes/performance.md", r"\| ([\d.]+ s) after the newest sample in it"),
    ),
    "400 recordings with one worker": (
        ("docs/scale.md", r"400 recordings .* take ([\d.]+) s with one worker"),
        ("benchmarks/notes/scale.md", r"\| 1 \| 400 \| ([\d.]+) s"),
        ("benchmarks/notes/performance.md", r"400 take ([\d.]+) s with one worker"),
    ),
    "400 recordings with two workers": (
        ("docs/scale.md", r"one worker and ([\d.]+) s with two"),
        ("benchmarks/notes/scale.md", r"\| 2 \| 400 \| ([\d.]+) s"),
        ("benchmarks/notes/performance.md", r"one worker, ([\d.]+) s with two"),
    ),
    "work of the program for a recording": (
        ("docs/scale.md", r"about ([\d.]+) ms of work for each"),
        ("benchmarks/notes/scale.md", r"driver, ([\d.]+) ms a recording"),
    ),
}


def differing(claims: tuple[tuple[str, str], ...]) -> list[str]:
    """What pages say where they do not say the same, or nothing at all; empty where they agree."""
    found = [
        (page, number[1] if (number := re.search(about, read(page))) else "nothing")
        for page, about in claims
    ]
    numbers = {number for _, number in found}
    return [] if len(numbers) == 1 and numbers != {"nothing"} else [": ".join(f) for f in found]


def read(page: str) -> str:
    """A page with its lines joined where they wrap."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.sub(r"(?<=\S)\n(?=[a-z(])", " ", text)


@pytest.mark.parametrize("name", SAME)
def test_a_figure_is_the_same_on_every_page(name: str):
    """Mutation: an exam is held anew and one of the two pages keeps the old number."""
    assert differing(SAME[name]) == []


def test_figures_that_differ_are_seen():
    """The test above is able to fail: 10 recordings hid nothing, 100 were in the set."""
    wrong = differing(
        (SAME["recordings of the set"][0], SAME["nothing hidden, nothing claimed"][1])
    )
    assert len(wrong) == 2


def test_the_front_page_and_the_tutorial_show_the_same_answer():
    """Line by line, however they are indented. Mutation: one of them made with an older search."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```text\n(.*?)```", readme, re.DOTALL)
    shown = [line.strip() for line in block.splitlines() if line]
    assert len(shown) >= 4
    tutorial = [
        line.strip()
        for line in (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8").splitlines()
    ]
    assert [line for line in shown if line not in tutorial] == []


def test_the_table_of_machines_has_the_verdicts_of_their_pages():
    """Mutation: a page made anew, and its line in the table left as it was."""
    folder = ROOT / "docs" / "machines"
    table = (folder / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[[^]]+\]\((\w+)\.md\) .*\| `(\w+)` \|$", table, re.MULTILINE)
    assert len(rows) == len([p for p in folder.glob("*.md") if p.stem != "README"])
    for name, verdict in rows:
        page = (folder / f"{name}.md").read_text(encoding="utf-8")
        said = re.search(r"^Verdict: `(\w+)`\.$", page, re.MULTILINE)
        assert said is not None, name
        assert said[1] == verdict, name


# A number with a unit or a percentage, as pages write findings.
FIGURE = re.compile(
    r"(?<![\w.])(\d+(?:\.\d+)?)\s(%|mm|µm|mN m|mN|kN|N m|N|ms|µs|mrad|rad/s|rad)(?!\w)"
)


def figures_of(text: str) -> set[str]:
    """The numbers with their units in a text."""
    joined = re.sub(r"\s+", " ", text.replace("\u00a0", " "))
    return {f"{number} {unit}" for number, unit in FIGURE.findall(joined)}


def test_every_figure_of_the_table_of_machines_stands_on_the_page_of_its_machine():
    """Mutation: a page made anew, and a figure of its line left as it was."""
    folder = ROOT / "docs" / "machines"
    table = (folder / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^(\| \[[^]]+\]\((\w+)\.md\) .*)$", table, re.MULTILINE)
    assert len(rows) > 10
    wrong = {
        name: sorted(missing)
        for row, name in rows
        if (missing := figures_of(row) - figures_of((folder / f"{name}.md").read_text("utf-8")))
    }
    assert wrong == {}
