"""`zwidth conceal`: recordings with physics concealed in them, and sealed keys."""

from pathlib import Path

import click

from zwidth.console import Console, progress
from zwidth.exam.conceal import conceal, orders
from zwidth.exam.strata import STRATA, counts
from zwidth.jobs.choose import executor
from zwidth.options import Quantity, cluster_option, force_option, json_option, out_option

CLASSES = "; ".join(f"{s.name}: {s.title}" for s in STRATA.values())


@click.command("conceal", epilog=f"Classes (the limit is that of detection): {CLASSES}.")
@click.option("--count", type=click.IntRange(1),
              help="Number of recordings with effects near the detection limit, in all classes"
              " together. Default: 200 if no other option asks for recordings.")  # fmt: skip
@click.option("--strata", metavar="NAME=N,...",
              help="Number for each class instead, such as none=100,single_2x=50.")  # fmt: skip
@click.option("--rigs", type=click.IntRange(0), default=0,
              help="Number of rigs: machines with several effects at full size.")  # fmt: skip
@click.option("--outside", type=click.IntRange(0), default=0,
              help="Number of recordings with a law that is not in the library.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True,
              help="Seed of all random numbers. The same seed makes the same files, so keep"
              " it as secret as the keys.")  # fmt: skip
@click.option("--seconds", type=Quantity("s", 2.0),
              help="Length of each recording. Default: 10 to 20 s; rigs: 6 to 30 s.")  # fmt: skip
@click.option(
    "--processes", type=click.IntRange(1), help="Number of parallel processes. Default: 1."
)
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
    """Make simulated recordings with concealed physics, to test a diagnosis.

    DIR/recordings contains what a diagnosis may use: for each recording a CSV, its description and
    a device file. A rig may have a second recording (r0001_2) and a held-out one
    (r0001_validation). DIR/keys contains the concealed truths; do not give them to a diagnosis.
    After an interruption, the same command continues where it stopped.
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
