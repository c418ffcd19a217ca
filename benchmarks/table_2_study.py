"""Print the study of Table II: each candidate fitted, and judged by rows left out.

python -m benchmarks.table_2_study [CANDIDATE ...]
"""

import sys

from zwidth.paper.table_2_study import CANDIDATES, study


def main() -> None:
    head = "fitted: K I    K II   f I   none | left out: K I    K II   f I   none"
    print(f"{'candidate':38} {head}")
    for name in sys.argv[1:] or CANDIDATES:
        (judged,) = study([name])
        cells = "   ".join(
            f"{e.part_1:7.2f} {e.part_2:7.2f} {e.frequency_hz:5.2f} {e.without:3d}"
            for e in (judged.fitted, judged.left_out)
        )
        values = ", ".join(f"{key} {value:+.3f}" for key, value in judged.values.items())
        print(f"{name:38} {cells}   {values}", flush=True)


if __name__ == "__main__":
    main()
