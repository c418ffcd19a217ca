"""What a perfect model would err: the drift that no knowledge of the first samples takes away.

A device without a spring integrates. Whoever knows it exactly, and its command, still errs in a
free run by two things:

- state: the first samples tell the state as well as their reading allows. Shown by the answer's
  own device that reads in the encoder's steps, with nothing else acting;
- chance: forces that nobody commanded and no model foretells. What the answer leaves unexplained,
  sample by sample on the training data, is drawn again in blocks and put into the same device (in
  innovation form, as its observer counts it), which then runs under the test's command. Blocks keep
  how one sample's error depends on the last; what of it is the model's fault and not chance is
  counted as chance, so this floor is none that a better model could not pass.

Neither needs any reading of the test: the command alone.
"""

import numpy as np
from numpy.typing import NDArray

from zwidth import Diagnosis
from zwidth.diagnosis.noise.family import followed_by
from zwidth.diagnosis.noise.predictor import SETTLING, driven, innovations
from zwidth.diagnosis.recording.experiment import Experiment

Floats = NDArray[np.float64]
DRAWS = 20
BLOCK_S = 0.5


def floors(answer: Diagnosis, command: Floats, window: int, step: float) -> tuple[float, Floats]:
    """Return the rms errors [m] by the state alone, and by chance (DRAWS,).

    command (ticks,) [N]: of the test; window: samples that tell the state; step [m]: the
    encoder's.
    """
    found = answer.predicts_with
    model, x, observer = found.final.model, found.final.x, found.judge
    like = answer.experiments[0]
    device = model.acting(x)
    seen = followed_by(device, model.seen(like, x), observer)
    left = innovations(device, seen, observer.gain)[SETTLING:]

    def run(errors: Floats) -> Floats:
        new = Experiment(
            like.period, command, np.zeros(errors.shape), like.outputs, swing=like.swing
        )  # fmt: skip
        return driven(device, new, observer, errors)[:, 0]

    def error(true: Floats, read: Floats) -> float:
        off = answer.predict(command, read[:window]) - true
        return float(np.sqrt(np.mean(off[window:] ** 2)))

    still = run(np.zeros((command.size, 1)))
    rng = np.random.default_rng(0)
    block = round(BLOCK_S / like.period)
    each: list[float] = []
    for _ in range(DRAWS):
        starts = rng.integers(0, left.shape[0] - block, -(-command.size // block))
        drawn = np.concatenate([left[s : s + block] for s in starts])[: command.size]
        true = run(drawn)
        each.append(error(true, true))
    return error(still, step * np.round(still / step)), np.array(each)
