"""Every key of a device file: unit, default and what it means (`sim/device_file.py`)."""

from dataclasses import fields

from zwidth.sim.drive import NEEDED, POSSIBLE
from zwidth.sim.estimators import ESTIMATORS, MOST_WINDOW
from zwidth.sim.interface import Interface
from zwidth.sim.keys import Key
from zwidth.sim.uncertainty import Uncertainty

_NEUTRAL, _USUAL = Interface(), Uncertainty()
_FORCE, _LENGTH = ("N m", "N"), ("rad", "m")
_DAMPER, _SPRING = ("N m s/rad", "N s/m"), ("N m/rad", "N/m")


def _interface(name: str, field: str, meaning: str, *units: str, example: str = "") -> Key:
    value = getattr(_NEUTRAL, field)
    default = f'"{value}"' if isinstance(value, str) else f"{value:g}"
    return Key("interface", name, meaning, *(units or ("", "")), default=default, example=example)


def _drive(name: str, meaning: str, unit: str, linear_unit: str = "", default: str = "") -> Key:
    kinds = [kind for kind in NEEDED if name in (*NEEDED[kind], *POSSIBLE[kind])]
    return Key("drive", name, f"{meaning} ({', '.join(kinds)})", unit, linear_unit, default)


DEVICE_KEYS: tuple[Key, ...] = (
    Key("", "schema", "version of this format", default="1", example="1"),
    Key("", "name", "name in reports and pictures", example='"axis of a desk robot"'),
    Key("", "source", "where the numbers come from", default='""', example='"data sheets"'),
    Key("", "rotary", "true: it turns, N m and rad; false: it slides, N and m", example="true"),
    Key("chain", "masses", "one to five in a row; force and encoder at the first, m1", "kg m2",
        "kg", example="[1.5e-3, 0.8e-3]"),
    Key("chain", "ground_dampers", "dampers from each mass to ground", *_DAMPER,
        example="[4e-3, 2e-3]"),
    Key("chain", "ground_spring", "spring from m1 to ground", *_SPRING, default="0",
        example="0.0"),
    Key("chain", "link_springs", "springs from each mass to the next", *_SPRING, default="[]",
        example="[12.0]"),
    Key("chain", "link_dampers", "dampers from each mass to the next", *_DAMPER, default="[]",
        example="[0.01]"),
    Key("modal", "m_kgm2", "total inertia; m_kg for a device that slides",
        "kg m2"),
    Key("modal", "m_kg", "total mass", "kg"),
    Key("modal", "b_nms_per_rad", "total damping; b_ns_per_m for a device that slides",
        "N m s/rad"),
    Key("modal", "b_ns_per_m", "total damping", "N s/m"),
    Key("modal.mode", "omega_rad_s", "resonance", "rad/s"),
    Key("modal.mode", "c_rad_s", "its damping: twice damping ratio times frequency", "rad/s"),
    Key("modal.mode", "v_rad_s", "antiresonance", "rad/s"),
    Key("modal.mode", "d_rad_s", "its damping: twice damping ratio times frequency", "rad/s"),
    _interface("period_s", "period", "sampling period", "s", example="0.001"),
    _interface("delay_s", "delay", "from a reading to the effect of its command; any value", "s"),
    _interface("encoder_step", "encoder_step", "resolution of the position; 0: none", *_LENGTH),
    _interface("command_step", "command_step", "resolution of the command; 0: none", *_FORCE),
    _interface("command_limit", "command_limit", "largest force; inf: none", *_FORCE),
    _interface("velocity_cutoff_hz", "velocity_cutoff_hz",
               "low-pass of the speed that a controller sees; inf: none", "Hz"),
    _interface("encoder_rounding", "encoder_rounding", 'to the nearest step, or down ("floor")'),
    _interface("command_gain", "command_gain", "force for one unit of the command"),
    _interface("position_origin", "position_origin",
               "reading at which the spring to ground is relaxed", *_LENGTH),
    _interface("command_hold", "command_hold",
               'a recorded command between samples: held, or "smooth" if it is band-limited'),
    _interface("velocity_order", "velocity_order", "order of that low-pass, 1 or 2 (Butterworth)"),
    _interface("velocity_ticks", "velocity_ticks",
               "samples from one estimate of the speed to the next; each is over as many"),
    _interface("velocity_estimator", "velocity_estimator",
               f"how the speed is computed from the readings: {', '.join(ESTIMATORS)}"),
    _interface("velocity_window", "velocity_window",
               f"foaw, foaw_end: most samples to look back, 2 to {MOST_WINDOW}"),
    _interface("velocity_band", "velocity_band",
               "foaw, foaw_end: allowed distance of readings from the line; usually encoder_step",
               *_LENGTH),
    _interface("velocity_noise", "velocity_noise",
               "kalman, kalman_acceleration: error of a reading (one sigma); for an encoder its"
               " step over 3.46", *_LENGTH),
    _interface("velocity_acceleration", "velocity_acceleration",
               "levant: the largest acceleration; kalman: one sigma of it; kalman_acceleration: one"
               " sigma of its change in a sample", "rad/s2", "m/s2"),
    _interface("velocity_step", "velocity_step",
               "resolution of the speed that a law gets (a register); 0: none", "rad/s", "m/s"),
    _interface("position_ticks", "position_ticks",
               "samples from one new position for the law to the next (a slower outer loop)"),
    _interface("force_sensor", "force_sensor", 'the link whose force is measured; "": none',
               example='"link12"'),
    _interface("force_gain", "force_gain", "gain of the feedback of the measured force"),
    Key("drive", "kind", "what the command is: voltage, current, duty, servo or position",
        example='"voltage"'),
    _drive("motor_constant", "force of the motor per unit of current", "N m/A", "N/A"),
    _drive("resistance_ohm", "resistance of the winding", "ohm"),
    _drive("gear", "turns of the motor, or its travel, over those of m1", "", default="1"),
    _drive("supply_v", "largest voltage, that of the supply", "V", default="inf"),
    _drive("back_emf", "voltage per unit of speed", "V s/rad", "V s/m", default="motor_constant"),
    _drive("inductance_h", "inductance of the winding", "H", default="0"),
    _drive("bandwidth_hz", "bandwidth of the current loop", "Hz", default="inf"),
    _drive("limit_a", "largest current", "A", default="inf"),
    _drive("proportional", "voltage per unit of the distance to the goal", "V/rad", "V/m"),
    _drive("derivative", "voltage per unit of speed", "V s/rad", "V s/m", default="0"),
    _drive("integral", "voltage rate per unit of the distance to the goal", "V/(rad s)", "V/(m s)",
           default="0"),
    _drive("integral_limit_v", "largest voltage of the integral", "V", default="inf"),
    _drive("goal_rate", "largest speed at which the goal is followed", "rad/s", "m/s",
           default="inf"),
    _drive("when_off", "state of the winding while the drive is off: shorted, so that its"
           " back-EMF brakes, or open", "", default='"shorted"'),
    _drive("stiffness", "force per unit of the distance to the goal", *_SPRING),
    _drive("damping", "force per unit of speed", *_DAMPER, default="0"),
    _drive("limit", "largest force of the loop", *_FORCE, default="inf"),
    *(
        Key("uncertainty", field.name, meaning, *units, default=f"{getattr(_USUAL, field.name):g}")
        for field, (meaning, *units) in zip(
            fields(Uncertainty),
            (
                ("how well the scale of the command is known (one sigma); 0: exactly", "share"),
                ("how well masses are known (one sigma)", "share"),
                ("how well springs are known (one sigma)", "share"),
                ("how well dampers are known (one sigma)", "share"),
                ("offset of the position sensors of further masses from that of m1 while links are"
                 " at rest (one sigma); 0: none", "rad", "m"),
            ),
            strict=True,
        )
    ),
    Key("band", "window_s", "length of a free run", "s"),
    Key("band", "windows", "number of free runs that the diagnosis judged"),
    Key("band", "observer_ratio", "ratio of process to measurement variance of the observer that"
        " starts them"),
    Key("band", "corrected", "faults that were corrected in the recordings", default="[]"),
    Key("band", "simulator", "simulator that these errors belong to; empty: the device itself",
        default='""', example='"MuJoCo 4.0.0"'),
    Key("band.output", "name", 'name of the output, such as "position_m1"'),
    Key("band.output", "error", "rms error of free runs; all values here are in the output's unit"),
    Key("band.output", "noise", "rms error one step ahead"),
    Key("band.output", "motion", "rms motion in the windows"),
    Key("band.output", "scatter", "standard deviation of windows' mean squares over their mean"),
    Key("posterior", "names", "numbers that a diagnosis fitted"),
    Key("posterior", "sd", "standard deviation of each, in its SI unit"),
    Key("posterior", "correlation", "correlation of each pair; for masses, springs, gain and limit"
        " that of their logarithms"),
    Key("physics", "effect", "further physics: a name that 'zwidth effects' lists",
        example='"backlash"'),
    Key("physics", "at", "where: m1 to m5, link12 to link45, ground, command, clock, sensor",
        example='"link12"'),
)  # fmt: skip
"""A [[physics]] table also has the parameters of its effect (`Effect.parameters`)."""
