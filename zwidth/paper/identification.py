"""Fig. 3 and Table I recovered by the paper's white-noise experiment on the simulated device."""

import numpy as np

from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.figures.bode import bode_figure
from zwidth.identification.coordinates import parameters
from zwidth.identification.fit import Fit, fit_response
from zwidth.paper.content import Picture, Section, Table
from zwidth.paper.theory import phantom
from zwidth.sim.modal import ModalModel
from zwidth.sim.run import simulate
from zwidth.sim.sampled import sampled_frequency_response
from zwidth.sim.trace import Trace

SEED = 0
NOISE = 1e-5  # [rad] rms at the sensor
SECONDS = 30.0
COMMAND = "zwidth paper --section identification"
UNITS = {"m": "kg m2", "b": "N m s/rad"}


def experiment() -> Trace:
    """Return 30 s of white noise, 0.7 to 300 Hz, on Table I's device, with noise at its sensor."""
    command = noise(duration=SECONDS, seed=SEED)
    trace = simulate(phantom(0.0), recorded(command), duration=SECONDS).trace
    disturbed = np.random.default_rng(SEED).normal(0.0, NOISE, len(trace))
    channels = {**trace.channels, "position_m1": trace["position_m1"] + disturbed}
    return trace.with_channels(channels)


def section() -> Section:
    """Return the Bode diagram, Table I recovered, and how many modes the data show."""
    true = phantom(0.0).modal
    assert true is not None
    fit = fit_response(experiment())
    inside = sum(low <= truth <= high for _, truth, _, low, high in _compared(fit, true))
    frequency = np.geomspace(0.7, 499.0, 800)
    period = phantom(0.0).interface.period
    figure = bode_figure(
        (fit.response.frequency_hz, fit.response.value),
        (frequency, sampled_frequency_response(fit.model, period, frequency)),
        (frequency, sampled_frequency_response(true, period, frequency)),
    )
    return Section(
        "Fig. 3 and Table I: the device identified",
        (
            Picture(
                "fig_3", figure,
                "Fig. 3. Discrete-time Bode diagram: response of the simulated device to white"
                " noise, 0.7 to 300 Hz over 30 s, windows of 4096 samples (points); the model"
                " fitted to it (solid, ours) and Table I (dashed, theirs). Their own recording is"
                f" not published; ours has {1e6 * NOISE:.0f} \N{MICRO SIGN}rad rms of noise at its"
                " sensor.",
                COMMAND,
            ),
            f"The data ask for {len(fit.model.modes)} modes. Of the {len(fit.names)} parameters of"
            f" Table I, {inside} lie inside their own 95 % interval here (19 in 20 are meant to).",
            Table(
                "Table I recovered from the recording, started from the data alone.",
                ["parameter", "unit", "Table I", "fitted", "95 % interval", "inside"],
                [
                    [name, UNITS.get(name, "rad/s"), f"{truth:.6g}", f"{value:.6g}",
                     f"{low:.6g} to {high:.6g}", "yes" if low <= truth <= high else "no"]
                    for name, truth, value, low, high in _compared(fit, true)
                ],
                COMMAND, (0, 1),
            ),
        ),
    )  # fmt: skip


def _compared(fit: Fit, true: ModalModel) -> list[tuple[str, float, float, float, float]]:
    """Name, true value, fitted value and its interval, where the number of modes agrees."""
    truths = parameters(true).tolist()
    return [
        (name, truth, value, low, high)
        for (name, (value, low, high)), truth in zip(fit.intervals().items(), truths, strict=False)
    ]
