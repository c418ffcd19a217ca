"""A device from a recording of its command and position."""

from zwidth.api.given import AnyRecording, name_of, trace_of
from zwidth.api.notebook import telling
from zwidth.identification.fit import fit_response
from zwidth.identification.identified import Identified, identified


def identify(
    recording: AnyRecording,
    modes: int | None = None,
    *,
    delay: float | None = 0.0,
    command: str = "command",
    position: str = "position_m1",
    from_hz: float = 0.7,
    to_hz: float = 300.0,
    name: str | None = None,
) -> Identified:
    """Fit a device to a recording of its command and position.

    recording: a path (a recording TOML, a log), a Trace, a Run or a Log. modes: number of vibration
    modes, 0 for a rigid body; None: as many as the data show. delay [s] from command to force; None
    fits it too. command, position: names of the channels. from_hz, to_hz: the band that is used.
    name: of the device, by default the recording's.

    Raises ValueError with one sentence, which says what to record instead.
    """
    trace, known = trace_of(recording), name or name_of(recording)
    with telling(None, "fitting the device") as tell:
        fit = fit_response(
            trace, modes, output=position, command=command, delay=delay, from_hz=from_hz,
            to_hz=to_hz, say=tell,
        )  # fmt: skip
    source = f"identified from {name_of(recording)}"
    return identified(fit, known, trace.units[position], source, position)
