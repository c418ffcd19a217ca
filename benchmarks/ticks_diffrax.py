"""The bench of `benchmarks.ticks` in diffrax, smoothed: run by an interpreter that has diffrax.

Reads JSON, prints JSON: the least process time [s] of some rounds, the motion of m1, the creep.
diffrax takes smooth fields alone, so a sign is a tanh, and the link's damper sets in over a width.
"""

import json
import sys
import time
from typing import Any

import diffrax  # pyright: ignore[reportMissingImports]
import jax  # pyright: ignore[reportMissingImports]
import jax.numpy as jnp  # pyright: ignore[reportMissingImports]


def main() -> None:
    given: dict[str, Any] = json.loads(sys.stdin.read())
    jax.config.update("jax_enable_x64", True)
    m1, m2, k, c, level, gap = (given[n] for n in ("m1", "m2", "k", "c", "level", "gap"))
    members, steps, period = given["members"], given["steps"], given["period"]
    slow, corner = given["slow"], given["corner"]

    def run(command: Any, scale: Any) -> Any:
        ticks = command.shape[0]

        def field(t: Any, x: Any, _: Any) -> Any:
            q1, q2, v1, v2 = x
            u = command[jnp.minimum(jnp.floor(t / period), ticks - 1).astype(int)]
            d = q1 - q2
            s = d - jnp.clip(d, -0.5 * gap, 0.5 * gap)
            touching = jax.nn.sigmoid((jnp.abs(d) - 0.5 * gap) / corner)
            link = k * s + c * touching * (v1 - v2)
            rubs = level * scale * jnp.tanh(v1 / slow)
            return jnp.array([v1, v2, (u - rubs - link) / m1, link / m2])

        found = diffrax.diffeqsolve(
            diffrax.ODETerm(field), diffrax.Tsit5(), 0.0, ticks * period, period / steps,
            jnp.zeros(4), saveat=diffrax.SaveAt(ts=jnp.arange(ticks) * period),
            max_steps=ticks * steps + 8,
        )  # fmt: skip
        return found.ys[:, 0]

    together = jax.jit(jax.vmap(run, in_axes=(None, 0)))
    scales = jnp.array(given["scales"])
    command = jnp.array(given["command"])
    motion = together(command, scales)
    motion.block_until_ready()
    spent: list[float] = []
    for _ in range(given["rounds"]):
        begun = time.process_time()
        together(command, scales).block_until_ready()
        spent.append(time.process_time() - begun)
    still = together(jnp.full(given["hold_ticks"], 0.5 * level), jnp.ones(members))
    print(json.dumps({
        "seconds": min(spent), "motion": motion[0].tolist(),
        "creep": float(jnp.abs(still[0, -1] - still[0, given["hold_ticks"] // 10])),
    }))  # fmt: skip


if __name__ == "__main__":
    main()
