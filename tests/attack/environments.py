"""Environments that are misused, each beside a twin that is not: whatever is refused leaves nothing changed."""

import copy
import pickle

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

import rj_gym
from agents.runs.state_file import packed, unpacked
from rollingjoint import RollingJointError

IDS = {  # id: weight, lanes of a batch, steps of a round
    "rj_gym/RollingJoint-v0": (4, 256, 120),
    "rj_gym/RollingJointGoal-v0": (3, 256, 120),
    "rj_gym/Instrument-v0": (2, 256, 120),
    "rj_gym/InstrumentShift-v0": (1, 256, 120),
    "rj_gym/SlowCamera-v0": (1, 256, 120),
    "rj_gym/LatePose-v0": (1, 256, 120),
    "rj_gym/FlexibleArm-v0": (1, 16, 40),
    "rj_gym/FlexibleArmGoal-v0": (0.5, 16, 40),
    "rj_gym/PitchYaw-v0": (1, 64, 60),
    "rj_gym/ArmInstrument-v0": (0.5, 16, 40),
    "rj_gym/ManyMechanisms-v0": (0.5, 32, 70),
    "rj_gym/ManyMechanismsInSpace-v0": (0.5, 32, 70),
    "rj_gym/CurvatureDesign-v0": (0.1, 4, 8),
    "rj_gym/CoDesign-v0": (0.1, 4, 8),
    "rj_gym/Lumen-v0": (1, 32, 70),
    "rj_gym/Obstacles-v0": (0.1, 2, 70),
    "rj_gym/Obstacles-v1": (0.5, 8, 70),
    "rj_gym/HiddenWall-v0": (0.5, 32, 70),
}
SETTINGS = (
    {},
    {"friction": {"mu": [0.02, 0.1]}},
    {"observe_history": 2},
    {"episode_steps": 7},
    {"sensing": {"period": 3, "delay": 1}},
    {"actuation": {"play_mm": [0.0, 1.0], "delay": 1}},
    {"randomization": {"stiffness_scale": [0.8, 1.2]}},
)
REFUSED = (RollingJointError, ResetNeeded)
_BAD_NUMBERS = (np.nan, np.inf, -np.inf)
_JUNK = (
    None,
    "x",
    b"x",
    {},
    [],
    tuple(range(11)),
    1.5,
    -1,
    True,
    np.nan,
    2**70,
    [[1.0], [2.0, 3.0]],
    object(),
    np.zeros((0, 3)),
)


def attack(rng, report):
    """One environment of a random id with random settings, of many lanes or of one."""
    weights = np.array([weight for weight, _, _ in IDS.values()])
    name = str(rng.choice(list(IDS), p=weights / weights.sum()))
    _, lanes, steps = IDS[name]
    settings = {} if "Design" in name else dict(SETTINGS[rng.integers(len(SETTINGS))])
    alone = rng.random() < 0.15
    lanes, steps = (1, steps) if alone else (lanes, steps)
    mode = str(rng.choice(["NextStep", "SameStep"]))
    try:
        pair = [_made(name, lanes, alone, mode, settings) for _ in range(2)]
    except RollingJointError:  # such as settings that this task has not
        pair = [_made(name, lanes, alone, mode, {}) for _ in range(2)]
    try:
        _compare(rng, report, pair, lanes, steps, alone, name)
        if not alone:
            _enter_hostile_states(rng, report, pair[0])
    finally:
        for env in pair:
            env.close()


def _made(name, lanes, alone, mode, settings):
    if alone:
        return gymnasium.make(name, **settings).unwrapped
    return gymnasium.make_vec(name, lanes, "vector_entry_point", autoreset_mode=mode, **settings)


def _compare(rng, report, pair, lanes, steps, alone, name):
    """Drive both alike, the first one misused in between; every output is the same to the last bit."""
    victim, twin = pair
    for _ in range(2):
        _misuse(rng, report, victim, lanes, alone)
    seed = int(rng.integers(2**31))
    _same(report, victim.reset(seed=seed), twin.reset(seed=seed), f"{name}: first reset")
    over = False
    for step in range(steps):
        if rng.random() < 0.2:
            _misuse(rng, report, victim, lanes, alone)
        if over or rng.random() < 0.03:
            options = _options(rng, victim, lanes, alone)
            with report.limited("two resets"):
                results = [_reset(env, None, copy.deepcopy(options)) for env in pair]
        else:
            action = _action(rng, victim)
            with report.limited("two steps"):
                results = [env.step(action) for env in pair]
            report.count("environment steps", lanes)
            over = alone and (results[0][2] or results[0][3])
        if not _same(report, *results, f"{name}: step {step}"):
            return
        if step == steps // 2:
            pair[0] = victim = pickle.loads(pickle.dumps(victim))
            if not alone:
                state = victim.get_state()
                victim.reset(seed=1)
                victim.set_state(unpacked(packed(state), "state"))
        if len(results[0]) > 1:  # else a reset that both have refused
            _check(report, victim, results[0][0], name)


def _reset(env, seed, options):
    try:
        return env.reset(seed=seed, options=options)
    except REFUSED as error:
        return (str(error),)


def _action(rng, env):
    """Mostly random; sometimes far beyond the space, which is clipped."""
    action = rng.uniform(-1, 1, env.action_space.shape)
    if rng.random() < 0.1:
        action = action * 10.0 ** rng.uniform(0.0, 37.0)
    return action.astype(np.float32)


def _options(rng, env, lanes, alone):
    """Options of a reset: none, a mask, or something held fixed, which may be refused."""
    task = env.unwrapped.task if alone else env.task
    dimension = getattr(task, "dimension", 2)
    options = {}
    if not alone and rng.random() < 0.5:
        options["reset_mask"] = rng.random(lanes) < 0.5
    match rng.integers(5):
        case 0:
            options["target"] = rng.normal(0.0, 30.0, dimension)
        case 1:
            options["load"] = {"link": -1, "force": rng.normal(0.0, 0.5, 2)} if dimension == 2 else rng.uniform(0, 0.5)
        case 2:
            options["start"] = rng.uniform(0.0, 12.0, task.action_size)
        case 3:
            options["actuator_offsets"] = rng.normal(0.0, 0.5, task.action_size)
    return options or None


def _misuse(rng, report, env, lanes, alone):
    """A call that has to be refused, or that changes nothing."""
    junk = _JUNK[rng.integers(len(_JUNK))]
    shape = env.action_space.shape
    bad = rng.uniform(-1, 1, shape)
    bad.reshape(-1)[rng.integers(bad.size)] = _BAD_NUMBERS[rng.integers(3)]
    calls = {
        "step with a bad number": lambda: env.step(bad),
        "step with a wrong shape": lambda: env.step(np.zeros((*shape, 2))),
        "step with junk": lambda: env.step(junk),
        "reset with a bad seed": lambda: env.reset(seed=[-1, 1.5, "x", np.nan, [1.5] * lanes, {}][rng.integers(6)]),
        "reset with bad options": lambda: env.reset(options={"no such option": junk}),
        "reset with a bad target": lambda: env.reset(seed=3, options={"target": (1e300, -1e300, 1e300)}),
        "reset with a junk target": lambda: env.reset(seed=3, options={"target": _not_number(junk)}),
        "reset with a bad load": lambda: env.reset(seed=3, options={"load": {"link": 99, "force": junk}}),
        "reset with a bad start": lambda: env.reset(seed=3, options={"start": [-1.0, np.nan]}),
    }
    if not alone:
        calls["reset with a bad mask"] = lambda: env.reset(options={"reset_mask": np.zeros(lanes, bool)})
        calls["bad seeds of lanes"] = lambda: env.reset(seed=[1] * (lanes - 1) + [-5])
    what = list(calls)[rng.integers(len(calls))]
    report.count("misused calls")
    try:
        calls[what]()
    except REFUSED as error:
        if "\n" in str(error):
            report.fail(f"{what}: a message of several lines: {str(error)[:200]!r}")
    else:
        report.fail(f"{what} ({junk!r}) was accepted")


def _enter_hostile_states(rng, report, env):
    """States in which numbers and arrays are others: refused, or stepped from without a crash."""
    for _ in range(4):
        state = copy.deepcopy(env.get_state())
        for _ in range(rng.integers(1, 4)):
            _spoil(rng, state)
        report.count("hostile states")
        try:
            env.set_state(state)
            with report.limited("steps from a hostile state"):
                for _ in range(3):
                    env.step(_action(rng, env))
        except REFUSED as error:
            if "\n" in str(error):
                report.fail(f"a message of several lines: {str(error)[:200]!r}")
        env.reset(seed=3)


def _spoil(rng, state):
    """Change one value somewhere in a state of nested dictionaries; an earlier change may have left none."""
    if not state:
        return
    key = list(state)[rng.integers(len(state))]
    value = state[key]
    if isinstance(value, dict) and rng.random() > 0.02:
        _spoil(rng, value)
        return
    if isinstance(value, np.ndarray) and value.size and rng.random() < 0.8:
        kind = value.dtype
        number = rng.choice([*_BAD_NUMBERS, -1.0, 0.5, 1e9, 1e300, float(rng.normal(0.0, 10.0))])
        places = rng.random(value.shape) < rng.choice([0.01, 1.0])
        with np.errstate(all="ignore"):
            value[places] = (
                np.full((), number).astype(kind)
                if kind.kind == "f"
                else int(np.nan_to_num(number, True, 7, 7, -7) % 2**31)
            )
    elif isinstance(value, np.ndarray):
        state[key] = (value[:-1], value.astype(np.float32), value.astype(object), value[..., None])[rng.integers(4)]
    else:
        state[key] = _JUNK[rng.integers(len(_JUNK))]


def _not_number(junk):
    return junk if not isinstance(junk, (int, float)) else "x"


def _check(report, env, observation, name):
    """Observations are finite and in their space."""
    arrays = observation.values() if isinstance(observation, dict) else [observation]
    if not all(np.all(np.isfinite(array)) for array in arrays):
        report.fail(f"{name}: an observation is not finite")
    if not env.observation_space.contains(observation):
        report.fail(f"{name}: an observation is not in its space")


def _same(report, one, other, where):
    """Whether two answers are equal to the last bit."""
    if not _equal(one, other):
        report.fail(f"{where}: differs from its twin")
        return False
    return True


def _equal(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_equal(one[key], other[key]) for key in one)
    if isinstance(one, (tuple, list)):
        return len(one) == len(other) and all(map(_equal, one, other))
    if isinstance(one, np.ndarray):
        if one.dtype == object:
            return one.shape == other.shape and all(map(_equal, one.ravel(), other.ravel()))
        return one.shape == other.shape and one.tobytes() == other.tobytes()
    return type(one) is type(other) and (one is other or one == other or repr(one) == repr(other))


assert rj_gym  # registers the environments
