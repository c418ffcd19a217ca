"""Draw the picture of docs/fleets.md, and print the findings on its recordings.

    python docs/make_fleet_picture.py

Fourteen simulated joints, six recordings each, with five faults and one friction that grows.
"""

import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from zwidth.exam.fleets import make_fleet, nominal
from zwidth.figures.fleet import fleet_figure
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_with
from zwidth.fleet.diagnosed import diagnose_fleet
from zwidth.fleet.listing import listed
from zwidth.jobs.executor import Local

DEVICES, RUNS, FAULTS, SEED = 14, 6, 5, 1
PICTURE = Path(__file__).parent / "fleet.png"


def main() -> None:
    """Make the fleet, diagnose it, draw it."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        make_fleet(folder / "fleet", DEVICES, RUNS, FAULTS, SEED)
        recordings = listed(folder / "fleet")
        say = partial(print, file=sys.stderr)
        found = diagnose_fleet(nominal(), recordings, folder / "work", Local(), say=say)
    for member in found.members:
        if member.reason is not None:
            print(f"{member.listed.name}: {member.reason.sentence}")
    for change in found.changes:
        print(found.said_of(change))
    with writing_as("make_fleet_picture", overwrite=True):
        figure = fleet_figure(found)
        write_with(PICTURE, lambda file: figure.savefig(file, format="png", dpi=150))


if __name__ == "__main__":
    main()
