"""Coverage of the 95 % intervals of a fit to simulated white noise on Table I's device.

python -m benchmarks.identification_coverage [--seeds 400] [--noise 1e-5]
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.identification.coordinates import parameters
from zwidth.identification.fit import Z95, fit_response
from zwidth.sim.device_file import load_device
from zwidth.sim.run import simulate


def deviations(seed: int, sigma: float) -> np.ndarray:
    device = load_device("phantom_1_0").with_interface(delay=0.0)
    assert device.modal is not None
    trace = simulate(device, recorded(noise(seed=seed)), duration=30.0).trace
    sensor = sigma * np.random.default_rng(10_000 + seed).standard_normal(len(trace))
    noisy = {**trace.channels, "position_m1": trace["position_m1"] + sensor}
    fit = fit_response(trace.with_channels(noisy), 2)
    return np.log(fit.values / parameters(device.modal)) / np.sqrt(np.diag(fit.covariance))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=400)
    parser.add_argument("--noise", type=float, default=1e-5)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.workers) as pool:
        one = partial(deviations, sigma=asked.noise)
        z = np.array(list(pool.map(one, range(asked.seeds), chunksize=5)))
    print(f"{asked.seeds} recordings, {asked.noise:g} rad of noise; no fit failed")
    for name, column in zip(
        ["m", "b", "omega_1", "c_1", "v_1", "d_1", "omega_2", "c_2", "v_2", "d_2"], z.T, strict=True
    ):
        share = np.mean(np.abs(column) < Z95)
        print(f"{name:8} covered {100 * share:5.1f} %   rms deviation {column.std():.3f}")


if __name__ == "__main__":
    main()
