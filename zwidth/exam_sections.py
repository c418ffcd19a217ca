"""Sections of the page of evidence: rigs at full size, unnamed laws, probabilities."""

from collections.abc import Mapping, Sequence
from typing import Any


def ratio(s: Mapping[str, Any]) -> str:
    """Return "93.1 % (27 of 29; 77.2 to 99.2 %)"."""
    if not s["count"]:
        return "none"
    low, high = s["ci95"]
    return (
        f"{100 * s['share']:.1f} % ({s['right']} of {s['count']};"
        f" {100 * low:.1f} to {100 * high:.1f} %)"
    )


def table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def held_out_line(of: str, s: Mapping[str, Any]) -> str:
    """Return a sentence on shares of the improvement that perfect knowledge gives."""
    if not s["count"]:
        return f"Held-out improvement on {of}: none to be told."
    return (
        f"Held-out improvement on {of}, share of perfect knowledge's: median"
        f" {100 * s['median']:.1f} %, lower quartile {100 * s['lower_quartile']:.1f} %, tenth"
        f" {100 * s['tenth']:.1f} % ({s['count']} recordings where perfect knowledge improves it by"
        " 2 % or more)."
    )


def laboratory_section(found: Mapping[str, Any]) -> str:
    """Return the section on machines recorded as laboratories do: `laboratory` in the JSON."""
    claimed = ", ".join(found["claimed"]) or "nothing"
    return (
        "# Recorded as laboratories do\n\nNothing is concealed in them. Readings are taken up to"
        " half a sample early or late and with jitter, stamps and commands are rounded, and"
        f" recordings begin in motion or after a rest. Of {found['recordings']}, false claims in"
        f" {ratio(found['false_claims'])}: {claimed}. Intervals of linear parameters hold the"
        f" truth: {ratio(found['coverage_linear'])}."
    )


def rig_section(rigs: Mapping[str, Any], title: str) -> str:
    """Return what is told of rigs: `rigs` or `mujoco` in the JSON of `zwidth exam`."""
    counts = [[n, ratio(s)] for n, s in rigs["by_count"].items()]
    effects = [
        [f"`{name}`", ratio(e["found"]), ratio(e["in_class"]), ratio(e["coverage"])]
        for name, e in rigs["by_effect"].items()
    ]
    clean = rigs["clean"]
    claimed = ", ".join(clean["claimed"]) or "nothing"
    false = ", ".join(f"{name.replace('@', ' at ')} {n}" for name, n in rigs["false_names"].items())
    return "\n\n".join(
        [
            f"# {title}",
            table(("effects of a rig", "all found, or in a class named"), counts),
            f"All named and nothing else: {ratio(rigs['all_named_nothing_else'])}. The first"
            f" finding is right in {ratio(rigs['first_right'])}. Of effects,"
            f" {ratio(rigs['effects_found'])}"
            f" were found, {ratio(rigs['effects_in_class'])} found or in a class.",
            table(("effect", "found", "or in a class", "intervals that hold it"), effects),
            f"Named and not there: {false or 'nothing'}. Of {clean['recordings']} clean rigs, false"
            f" claims in {ratio(clean['false_claims'])}: {claimed}. Verdicts:"
            f" {_counted(rigs['verdicts'])}. Intervals of linear parameters hold the truth:"
            f" {ratio(rigs['coverage_linear'])}.",
            held_out_line("the device file", rigs["held_out"]["share"]),
            held_out_line("the linear refit", rigs["held_out"]["share_beyond_refit"]),
        ]
    )


def outside_section(outside: Mapping[str, Any]) -> str:
    """Return the section on unnamed laws, from `outside` in the JSON of `zwidth exam`."""
    return "\n\n".join(
        [
            "# Unnamed laws",
            f"`unknown_physics` in {ratio(outside['said_so'])}; `identified` in"
            f" {ratio(outside['identified'])}. Of findings that stand alone, wrong:"
            f" {ratio(outside['confident_wrong_names'])}. Effects of the library beside the law,"
            f" found or in a class: {ratio(outside['beside'])}. Verdicts:"
            f" {_counted(outside['verdicts'])}.",
            held_out_line("the device file", outside["held_out"]["share"]),
        ]
    )


def calibration_section(found: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    """Return the section on the reliability of probabilities: `calibration` in the JSON."""
    rows = [
        [f"{r['from']:g} to {r['to']:g}", f"{r['said']:.3f}", ratio(r["seen"])]
        for r in found["table"]
    ]
    kinds = ", ".join(
        f"{kind} {c['expected_error']:.3f} ({c['statements']})"
        for kind, c in found["by_kind"].items()
    )
    return (
        "# Probabilities\n\n"
        + table(("said", "in the mean", "so"), rows)
        + f"\n\nExpected calibration error {found['expected_error']:.3f}; by kind: {kinds}."
        + f"\n\n![reliability]({pictures['reliability']})"
    )


def _counted(of: Mapping[str, int]) -> str:
    return ", ".join(f"`{name}` {n}" for name, n in sorted(of.items()))
