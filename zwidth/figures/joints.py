"""How well each joint of a recording is explained: errors of free runs, before and after."""

from collections.abc import Mapping

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.diagnosis.answer.result import HeldOut
from zwidth.figures.style import AFTER, BEFORE, STYLE


def joints_figure(errors: Mapping[str, HeldOut]) -> Figure:
    """Return two bars per joint: refitted, and with the effects found [% of the motion]."""
    places = np.arange(len(errors))
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 1.2 + 0.45 * max(1, len(errors))), layout="constrained")
        ax = figure.subplots()
        refit = [100.0 * e.refit for e in errors.values()]
        after = [100.0 * e.after for e in errors.values()]
        ax.barh(places - 0.2, refit, 0.36, color=BEFORE, label="refitted")
        ax.barh(places + 0.2, after, 0.36, color=AFTER, label="with the found effects")
        ax.set_yticks(places, list(errors))
        ax.invert_yaxis()
        ax.set_xlabel("error of free runs on held-out data [% of the motion]")
        ax.set_ylabel("joint")
        figure.legend(loc="outside lower center", ncols=2)
    return figure
