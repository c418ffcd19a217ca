"""`zwidth conceal`: recordings with physics concealed in them, and sealed keys."""

from pathlib import Path

import click

from zwidth.console import Console, progress
from zwidth.exam.conceal import conceal, orders
from zwidth.exam.strata import STRATA, counts
from zwidth.jobs.choose import executor
from zwidth.options import Quantity, cluster_option, force_option, json_option, out_option

CLASSES = "; ".join(f"{s.name}: {s.title}" for s in STRATA.values())


@click.command("conceal", epilog=f"Classes: {CLASSES}.")
@click.option("--count", type=click.IntRange(1),
              help="How many recordings at the limit, shared out over its classes; 200 where"
              " nothing else is asked for.")  # fmt: skip
@click.option("--strata", metavar="NAME=N,...",
              help="How many of each class instead, as none=100,single_2x=50.")  # fmt: skip
@click.option("--rigs", type=click.IntRange(0), default=0,
              help="How many rigs at full size besides.")  # fmt: skip
@click.option("--outside", type=click.IntRange(0), default=0,
              help="How many with a law of no name besides.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True,
              help="Same seed, same recordings, to the byte; keep it as the keys.")  # fmt: skip
@click.option("--seconds", type=Quantity("s", 2.0),
              help="Length of each recording, else 10 to 20 s, of rigs 6 to 30 s.")  # fmt: skip
@click.option("--processes", type=click.IntRange(1), help="Processes side by side, else one.")
@cluster_option
@out_option("runs/concealed")
@force_option
@json_option
def command(
    count: int | None,
    strata: str | None,
    rigs: int,
    outside: int,
    seed: int,
    seconds: float | None,
    processes: int | None,
    cluster: str | None,
    out: Path,
    json_file: str | None,
) -> None:
    """Make recordings in which physics is concealed, with sealed keys.

    DIR/recordings holds what a diagnosis gets: a CSV, its description and a device file each, which
    give nothing away; a rig may come with a second recording (r0001_2) and one to judge by
    (r0001_validation). DIR/keys holds what is concealed; keep it apart until the diagnoses are in.
    An interrupted run is taken up where it stopped.
    """
    console = Console(json_file)
    default = None if strata or rigs or outside else 200
    asked = counts(count or default, strata, rigs, outside)
    wanted = orders(out, asked, seed, seconds)
    console.will_write()
    with executor(cluster, processes) as runner, progress("concealing", len(wanted)) as advance:
        made = conceal(out, wanted, runner, lambda name: advance(now=name))
        advance(len(wanted) - made)
    many = "1 recording" if len(wanted) == 1 else f"{len(wanted)} recordings"
    console.say(
        f"{many} in {out / 'recordings'}, {'its key' if len(wanted) == 1 else 'their keys'}"
        f" in {out / 'keys'}"
    )
    console.result({"recordings": len(wanted), "made": made, "seed": seed, "classes": asked})
