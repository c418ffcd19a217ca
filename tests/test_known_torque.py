"""The rest of a robot as a known torque: closed forms, and a diagnosis that needs it."""

import json
from pathlib import Path

import numpy as np
import pytest

import zwidth
from zwidth import cli
from zwidth.api.given import experiments_of, named_traces
from zwidth.controllers.excitation import multisine
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.recording.experiment import ExperimentError, experiment
from zwidth.export.known_torque import known_torque, smooth_motion, with_known_torque
from zwidth.export.model import Floats, loss
from zwidth.export.mujoco_run import engine
from zwidth.export.read_joint import device_of_joint
from zwidth.logs.recording import read_recording
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.run import Start, simulate
from zwidth.sim.trace import Trace

needs_mujoco = pytest.mark.skipif(engine() is None, reason="MuJoCo is not installed")
GRAVITY = 9.81
T = np.linspace(0.0, 1.999, 2000)
INSIDE = slice(100, -100)  # a natural spline has no acceleration at its ends
PENDULUM = """<mujoco><option gravity="0 -9.81 0"/><worldbody><body>
<joint name="a" type="hinge" axis="0 0 1" armature="0.3" damping="0.2" frictionloss="0.1"/>
<inertial pos="0 -0.4 0" mass="2" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>"""
L1, C1, C2, M1, M2, I1, I2 = 0.5, 0.2, 0.15, 1.5, 0.8, 0.03, 0.02
ARM = f"""<mujoco><option gravity="0 -9.81 0"/><worldbody><body>
<joint name="base" type="hinge" axis="0 0 1" damping="0.4"/>
<inertial pos="{C1} 0 0" mass="{M1}" diaginertia="{I1} {I1} {I1}"/>
<body pos="{L1} 0 0"><joint name="up/elbow" type="hinge" axis="0 0 1" damping="0.1"/>
<inertial pos="{C2} 0 0" mass="{M2}" diaginertia="{I2} {I2} {I2}"/></body></body></worldbody>
<actuator><motor joint="base"/><motor joint="up/elbow"/></actuator></mujoco>"""


def moving() -> tuple[Floats, ...]:
    """Return q1, q1', q1'', q2, q2', q2'' of two sines."""
    w, u = 2 * np.pi * 1.0, 2 * np.pi * 1.7
    one = 0.8 * np.sin(w * T), 0.8 * w * np.cos(w * T), -0.8 * w**2 * np.sin(w * T)
    two = 1.1 * np.cos(u * T), -1.1 * u * np.sin(u * T), -1.1 * u**2 * np.cos(u * T)
    return *one, *two


def trace_of(**channels: Floats) -> Trace:
    return Trace(T, channels, dict.fromkeys(channels, "rad"), "recorded", {})


@needs_mujoco
def test_a_pendulum_has_its_weight_and_nothing_else(tmp_path: Path):
    """f = -m g l sin q; armature, damping and friction are the device's own.

    Mutations: the armature left in the device's share; the sign of the row.
    """
    (tmp_path / "m.xml").write_text(PENDULUM)
    q, *_ = moving()
    found = known_torque(trace_of(position_m1=q), tmp_path / "m.xml", "a", "position_m1")
    np.testing.assert_allclose(found.torque, -2.0 * GRAVITY * 0.4 * np.sin(q), atol=1e-6)


@needs_mujoco
def test_two_links_have_the_textbooks_torque(tmp_path: Path):
    """Of a planar arm, with h = m2 l1 c2: row 1 is M_11 q1'' + M_12 q2'' - h sin q2 (...) + g_1.

    Mutations: Coriolis forces of the tick before; the zero pose's inertia for the recorded one's;
    of the other joint only its position.
    """
    (tmp_path / "m.xml").write_text(ARM)
    q1, v1, a1, q2, v2, a2 = moving()
    h = M2 * L1 * C2
    own = I1 + I2 + M1 * C1**2 + M2 * (L1**2 + C2**2)
    row = (
        (own + 2 * h * np.cos(q2)) * a1 + (I2 + M2 * C2**2 + h * np.cos(q2)) * a2
        - h * np.sin(q2) * (2 * v1 * v2 + v2**2)
        + GRAVITY * ((M1 * C1 + M2 * L1) * np.cos(q1) + M2 * C2 * np.cos(q1 + q2))
    )  # fmt: skip
    trace = trace_of(position_m1=q1, joint_up_elbow=q2)
    found = known_torque(trace, tmp_path / "m.xml", "base", "position_m1")
    closed = (own + 2 * h) * a1 - row
    assert np.abs(found.torque - closed)[INSIDE].max() < 1e-3 * np.abs(closed).max()
    assert "the motion of up/elbow" in found.said
    alone = known_torque(trace_of(position_m1=q1), tmp_path / "m.xml", "base", "position_m1")
    assert "held in the zero pose, since not recorded: up/elbow" in alone.said


def test_a_motion_is_as_smooth_as_its_noise_allows():
    """Encoder steps of a thousandth: accelerations within 5 %, of clean positions to 1e-4.

    Mutation: the lambda of every other sample not doubled is 1.5 times worse, none of it a hundred.
    """
    q, v, a, *_ = moving()
    for y, rate, acceleration in ((q, 1e-6, 1e-4), (np.round(q / 1e-3) * 1e-3, 5e-3, 0.05)):
        _, v_found, a_found = smooth_motion(T, y)
        assert np.std((v_found - v)[INSIDE]) < rate * np.std(v)
        assert np.std((a_found - a)[INSIDE]) < acceleration * np.std(a)
    gap = q.copy()
    gap[500:510] = np.nan
    assert np.abs(smooth_motion(T, gap)[0] - q).max() < 1e-4
    assert not smooth_motion(T, np.ones(T.size))[1].any()


def driven_arm(seconds: float, period: float = 1e-3) -> tuple[Floats, Floats, Floats, Floats]:
    """Return t, command of the base, and both positions of the arm in MuJoCo, elbow on its own."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(ARM)
    model.opt.timestep, model.opt.integrator = period / 8, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    u = multisine(3.0, duration=seconds, period=period, from_hz=0.3, to_hz=4.0, seed=2)
    q = np.empty((u.size, 2))
    for k in range(u.size):
        q[k] = data.qpos
        holds = GRAVITY * (M1 * C1 + M2 * L1 + M2 * C2)  # its weight as it lies, by the motor
        aim = np.sin(9.0 * k * period)
        data.ctrl[:] = u[k] + holds - 12.0 * data.qpos[0], 6.0 * (aim - data.qpos[1])
        u[k] = data.ctrl[0]
        mujoco.mj_step(model, data, nstep=8)
    return np.linspace(0.0, (u.size - 1) * period, u.size), u, q[:, 0], q[:, 1]


@needs_mujoco
def test_our_joint_moves_as_mujocos_under_the_known_torque(tmp_path: Path):
    """A second of free run under the same command, within 0.2 % of the motion; without it 50 %.

    Mutations: the torque a tick late; that of the zero pose.
    """
    (tmp_path / "m.xml").write_text(ARM)
    device, _ = device_of_joint(tmp_path / "m.xml", "base")
    t, u, q1, q2 = driven_arm(1.3)
    units = {"command": "N m", "position_m1": "rad", "joint_up_elbow": "rad"}
    channels = {"command": u, "position_m1": q1, "joint_up_elbow": q2}
    trace = Trace(t, channels, units, "recorded", {})
    more, _ = with_known_torque(trace, device, tmp_path / "m.xml", "base")
    known = experiment(more, device).pushes
    assert known is not None
    cut = slice(150, 1150)  # away from the ends of the splines
    begin = Start(q1[150], smooth_motion(t, q1)[1][150])
    for force, least, most in ((known[cut], 0.0, 0.002), (None, 0.5, np.inf)):
        run = simulate(device, recorded(u[cut]), duration=1.0, start=begin, disturbance=force,
                       bound=1e9)  # fmt: skip
        assert least < loss(q1[cut], run.trace["position_m1"]) < most


def written(folder: Path, seconds: float) -> Path:
    """Write the arm's recording as CSV and TOML, in degrees, with a little noise."""
    t, u, q1, q2 = driven_arm(seconds, 0.005)
    random = np.random.default_rng(1)
    q1, q2 = (q + 1e-4 * random.standard_normal(q.size) for q in (q1, q2))
    rows = np.column_stack([t, u, np.rad2deg(q1), np.rad2deg(q2)])
    np.savetxt(folder / "arm.csv", rows, delimiter=",", header="t,u,q1,q2", comments="")
    (folder / "arm.toml").write_text("""\
file = "arm.csv"
time = "t"
[input]
signal = "u"
unit = "Nm"
[[output]]
signal = "q1"
unit = "deg"
quantity = "position"
at = "m1"
[[joint]]
signal = "q2"
unit = "deg"
name = "up/elbow"
""")
    return folder / "arm.toml"


@needs_mujoco
def test_a_recording_names_other_joints_and_known_forces(tmp_path: Path):
    """In their own units. Mutation: a joint's unit for the device's."""
    path = written(tmp_path, 1.0)
    text = path.read_text().replace('unit = "deg"\nname', 'unit = "mm"\nname')
    path.write_text(text + '[[known_force]]\nsignal = "u"\nunit = "mNm"\nat = "m1"\n')
    trace = read_recording(path)
    assert trace.units["joint_up_elbow"] == "m"
    assert trace.units["known_force_m1"] == "N m"
    np.testing.assert_allclose(trace["known_force_m1"], 1e-3 * trace["command"])
    device = Device("d", "-", True, make_chain([1.0], [0.1])).with_interface(period=0.005)
    found = experiment(trace, device)
    u = 1e-3 * trace["command"]
    assert found.pushes is not None
    np.testing.assert_allclose(found.pushes[:-1, 0], 0.5 * (u[1:] + u[:-1]))
    assert any("has a force besides its command" in note for note in found.notes)
    path.write_text(path.read_text().replace('at = "m1"\n[[joint]]', 'at = "m1"\n[[joint]]'))
    wrong = path.read_text().replace('"mNm"\nat = "m1"', '"mNm"\nat = "m2"')
    path.write_text(wrong)
    with pytest.raises(ExperimentError, match="has known_force_m2, but the device has 1 mass;"):
        experiment(read_recording(path), device)


@needs_mujoco
def test_what_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "m.xml").write_text(ARM)
    path = str(written(tmp_path, 2.0))
    robot = ["--known-torque", str(tmp_path / "m.xml"), "--joint"]
    device = ["--device", "ethz_haptic_paddle"]

    def refused(*line: str) -> str:
        assert cli.run(["diagnose", path, *line, "--out", str(tmp_path)]) == 2
        return capsys.readouterr().err

    assert "needs --device" in refused(*robot, "base")
    assert "must be given together" in refused(*device, *robot[:2])
    assert "has no joint 'elbow'" in refused(*device, *robot, "elbow")
    Path(path).write_text(Path(path).read_text().replace("up/elbow", "wrist"))
    assert "has a joint 'wrist', which m.xml does not" in refused(*device, *robot, "base")


@needs_mujoco
def test_a_diagnosis_with_the_arm_finds_nothing_missing(tmp_path: Path):
    """Quickly; and says that the force was known. Without it something large is missing.

    Mutation: the known force left out of the experiment.
    """
    (tmp_path / "m.xml").write_text(ARM)
    path = str(written(tmp_path, 6.0))
    model = str(tmp_path / "m.xml")
    save = str(tmp_path / "d.toml")
    assert cli.run(["devices", "--from", model, "--joint", "base", "--save", save]) == 0
    text = Path(save).read_text().replace("period_s = 0.001", "period_s = 0.005")
    Path(save).write_text(text)
    said = tmp_path / "x.json"
    line = ["diagnose", path, "--device", save, "--effort", "quick", "--no-wall"]
    line += ["--known-torque", model, "--joint", "base", "--out", str(tmp_path)]
    assert cli.run([*line, "--json", str(said)]) == 0
    result = json.loads(said.read_text())
    assert result["verdict"] in ("linear_parameters", "nothing_missing")


@needs_mujoco
def test_python_asks_the_same(tmp_path: Path):
    """Mutation: the arms left out of what judges."""
    (tmp_path / "m.xml").write_text(ARM)
    device, _ = device_of_joint(tmp_path / "m.xml", "base")
    device = device.with_interface(period=0.005)
    path = written(tmp_path, 5.0)
    (found,) = experiments_of(named_traces(path), device, (tmp_path / "m.xml", "base"))
    more, _ = with_known_torque(read_recording(path), device, tmp_path / "m.xml", "base")
    assert found.pushes is not None
    np.testing.assert_array_equal(found.pushes, experiment(more, device).pushes)
    with pytest.raises(ValueError, match="has no joint 'tip'"):
        zwidth.diagnose(path, device, known_torque=(tmp_path / "m.xml", "tip"))


def test_identification_says_that_it_does_not_know_the_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    device = Device("rail", "-", False, make_chain([2.0, 1.0], [3.0, 0.5], 0.0, [4e4], [5.0]))
    u = multisine(2.0, duration=10.0, period=1e-3, from_hz=0.5, to_hz=100.0, seed=1)
    run = simulate(device, recorded(u), duration=10.0)
    rows = np.column_stack([u, run.trace["position_m1"]])
    np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header="u,q", comments="")
    (tmp_path / "r.toml").write_text("""\
file = "r.csv"
period_s = 0.001
[input]
signal = "u"
unit = "N"
[[output]]
signal = "q"
unit = "m"
quantity = "position"
at = "m1"
[[known_force]]
signal = "u"
unit = "N"
at = "m1"
""")
    line = ["identify", str(tmp_path / "r.toml"), "--out", str(tmp_path), "--modes", "1"]
    assert cli.run(line) == 0
    assert "which this command does not use" in capsys.readouterr().err
