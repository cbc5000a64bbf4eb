"""Faults by kind: what each lays down in every family, how it grows, what is drawn, which one is heard, and what a file can get wrong."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from models.plants.inertia import tensor
from sim.bad_input import BadInput
from sim.faults import effects
from sim.faults.effects import Effect, wave
from sim.faults.events import KINDS, Event
from sim.faults.kinds import Fault, aliases, renamed
from sim.faults.parts import FAMILIES, Parts
from sim.faults.timeline import Timeline, schedule
from sim.randomness import Stream, generator
from sim.scenario import files

DT, TICKS = 0.1, 60
RING = np.array([[0, 0], [0, 2], [1, 1], [1, 3], [2, 2], [2, 0]])  # the leader is seen by the first and the third of three agents
PARTS = {
    "body": Parts("body", {"attitude": 3, "gyro": 3, "wheels": 4}, wheels=4),
    "formation": Parts("formation", {"attitude": 3}, 3, 4, messages=RING, noise=1e-4, gains=(0.5, 15.0, 20.0, 10.0)),
    "consensus": Parts(
        "consensus",
        {"position": 2, "speed": 2},
        3,
        axes=2,
        messages=RING,
        noise=(0.1, 0.2),
        disturbance=np.array([[0.1, 0.5, i] for i in (1, 2, 3)]),
    ),
}
PLAIN = Parts("body", {"attitude": 3, "gyro": 3, "wheels": 0})  # one body without wheels
FAULT: TypeAdapter[Event] = TypeAdapter(Fault)


def fault(**keys) -> Event:
    timed = {"start_s": 1.0} if {"duration_s", "end_s"} & keys.keys() else {"start_s": 1.0, "duration_s": 2.0}
    return FAULT.validate_python(timed | keys)


def laid(*faults: Event, parts=PARTS["body"], trials=2, seed=5) -> Timeline:
    return schedule([faults] * trials, parts, seed, np.arange(trials), TICKS, DT)


def values(timeline: Timeline, effect: Effect, trial: int = 0) -> np.ndarray:
    """Of one trial, (ticks, ...)."""
    found = [timeline.at(effect, k) for k in range(TICKS)]
    return np.array([one[trial if len(one) > 1 else 0] for one in found])


def but(shape: tuple[int, ...], neutral, *changed) -> np.ndarray:
    """An array that is neutral but where it is said."""
    out = np.array(np.broadcast_to(np.asarray(neutral, dtype=float), shape))
    for where, value in changed:
        out[where] = value
    return out


ALL, SECOND = slice(None), 1
WHEEL = (SECOND, 2)  # wheel 3 of agent 2
# what each kind lays down while it lasts, on one body and on agent 2 of three: by effect
LAID: dict[str, list[tuple[str, dict, dict[Effect, np.ndarray]]]] = {
    "float": [
        ("body", {"wheel": 3}, {effects.DRIVE_GAIN: but((4,), 1.0, (2, 0.0)), effects.DRIVE_OFFSET: np.zeros(4)}),
        ("formation", {"wheel": 3, "agents": [2]}, {effects.DRIVE_GAIN: but((3, 4), 1.0, (WHEEL, 0.0))}),
    ],
    "effectiveness": [
        ("body", {"wheel": "all", "remaining": 0.4}, {effects.DRIVE_GAIN: np.full(4, 0.4)}),
        ("formation", {"wheel": 3, "agents": [2], "remaining": 0.4}, {effects.DRIVE_GAIN: but((3, 4), 1.0, (WHEEL, 0.4))}),
    ],
    "constant-output": [
        (
            "body",
            {"wheel": 3, "torque_nm": 2e-3},
            {effects.DRIVE_GAIN: but((4,), 1.0, (2, 0.0)), effects.DRIVE_OFFSET: but((4,), 0.0, (2, 2e-3))},
        ),
        ("formation", {"wheel": 3, "agents": [2], "torque_nm": 2e-3}, {effects.DRIVE_OFFSET: but((3, 4), 0.0, (WHEEL, 2e-3))}),
    ],
    "lock": [
        ("body", {"wheel": 3}, {effects.LOCKED: but((4,), 0.0, (2, 1.0))}),
        ("formation", {"wheel": 3, "agents": [2]}, {effects.LOCKED: but((3, 4), 0.0, (WHEEL, 1.0))}),
    ],
    "friction": [
        ("body", {"wheel": 3, "torque_nm": 2e-4}, {effects.FRICTION: but((4,), 0.0, (2, 2e-4))}),
        ("formation", {"wheel": 3, "agents": [2], "torque_nm": 2e-4}, {effects.FRICTION: but((3, 4), 0.0, (WHEEL, 2e-4))}),
    ],
    "no-command": [
        ("body", {}, {effects.DRIVE_GAIN: np.zeros(4)}),
        ("formation", {"agents": [2]}, {effects.DRIVE_GAIN: but((3, 4), 1.0, (SECOND, 0.0))}),
        ("consensus", {"agents": [2]}, {effects.COMMAND_GAIN: but((3, 2), 1.0, (SECOND, 0.0))}),
    ],
    "constant-command": [
        (
            "plain",
            {"axis": "y", "torque_nm": 0.2},
            {effects.COMMAND_GAIN: np.array([1.0, 0, 1]), effects.COMMAND_OFFSET: np.array([0, 0.2, 0])},
        ),
        ("plain", {"torque_nm": [1, 2, 3]}, {effects.COMMAND_GAIN: np.zeros(3), effects.COMMAND_OFFSET: np.array([1.0, 2, 3])}),
        (
            "formation",
            {"agents": [2], "torque_nm": [1, 2, 3]},
            {effects.COMMAND_GAIN: but((3, 3), 1.0, (SECOND, 0.0)), effects.COMMAND_OFFSET: but((3, 3), 0.0, (SECOND, [1, 2, 3]))},
        ),
        ("consensus", {"agents": [2], "force_n": [1, 2]}, {effects.COMMAND_OFFSET: but((3, 2), 0.0, (SECOND, [1, 2]))}),
    ],
    "gains": [
        (
            "formation",
            {"agents": [2], "k1": 1.0, "gamma": 2.0},
            {effects.GAINS: but((3, 4), (0.5, 15.0, 20.0, 10.0), ((SECOND, 0), 1.0), ((SECOND, 3), 2.0))},
        )
    ],
    "constant-sliding": [("consensus", {"agents": [2], "constant_n": 0.3}, {effects.SLIDING: but((3, 2), 0.0, (SECOND, [1.0, 0.3]))})],
    "external-torque": [
        ("body", {"torque_nm": 0.5, "direction": [0, 0, 2]}, {effects.PUSH: np.array([0.0, 0.0, 0.5])}),
        ("formation", {"agents": [2], "torque_nm": 0.5, "direction": [0, 3, 4]}, {effects.PUSH: but((3, 3), 0, (SECOND, [0, 0.3, 0.4]))}),
    ],
    "periodic-torque": [
        ("body", {"amplitude_nm": 0.5, "pulsation_rad_s": 2.0}, {wave(2.0): np.array([0.5])}),
        ("formation", {"agents": [2], "amplitude_nm": 0.5}, {wave(1.0): but((3, 1), 0.0, (SECOND, 0.5))}),
        ("formation", {"agents": [2], "amplitude_nm": 0.5, "by_agent": True}, {wave(1.0, True): but((3, 1), 0.0, (SECOND, 0.5))}),
    ],
    "uniform-torque": [("body", {"amplitude_nm": 0.0}, {effects.PUSH: np.zeros(3)}), ("formation", {"amplitude_nm": 0.0}, {})],
    "external-force": [("consensus", {"agents": [2], "force_n": [1, 2]}, {effects.PUSH: but((3, 2), 0.0, (SECOND, [1, 2]))})],
    "inertia": [
        (
            "body",
            {"inertia_kg_m2": [3, 4, 5, 0.1, 0.2, 0.3], "centre_of_mass_um": [1, 2, 3]},
            {
                effects.OWN_MASS: np.zeros(1),
                effects.INERTIA: tensor((3, 4, 5, 0.1, 0.2, 0.3)),
                effects.CENTRE_OF_MASS: np.array([1e-6, 2e-6, 3e-6]),
            },
        ),
        ("formation", {"agents": [2], "add_kg_m2": [1, 2, 3]}, {effects.INERTIA: but((3, 3, 3), 0.0, (SECOND, np.diag([1, 2, 3])))}),
    ],
    "dynamics": [("consensus", {"agents": [2], "gain": [3, -1]}, {effects.DYNAMICS: but((3, 2), 1.0, (SECOND, [3, -1]))})],
    "disturbance-change": [
        (
            "consensus",
            {"agents": [2], "amplitude_n": 8, "rate_rad_s": 2},
            {effects.DISTURBANCE: but((3, 3), [[0.1, 0.5, 1], [0.1, 0.5, 2], [0.1, 0.5, 3]], (SECOND, [8, 2, 2]))},
        ),
        ("consensus", {"amplitude_n": 8, "rate_rad_s": 2, "by_agent": False}, {effects.DISTURBANCE: but((3, 3), (8, 2, 1))}),
    ],
    "noise": [
        ("body", {"sensor": "gyro", "factor": 5}, {effects.NOISE: np.array([1.0, 5, 1])}),
        ("formation", {"agents": [2], "factor": 5}, {effects.NOISE: but((3, 1), 1e-4, (SECOND, 5e-4))}),
        (
            "consensus",
            {"agents": [2], "sensor": "speed", "deviation": 5, "bias": 0.5},
            {effects.NOISE: but((3, 2), (0.1, 0.2), ((SECOND, 1), 5)), effects.BIAS: but((3, 4), 0.0, ((SECOND, slice(2, 4)), 0.5))},
        ),
    ],
    "bias": [
        ("body", {"sensor": "gyro", "size": 0.2}, {effects.BIAS: but((10,), 0.0, (slice(3, 6), 0.2))}),
        ("formation", {"agents": [2], "size": 0.2}, {effects.BIAS: but((3, 3), 0.0, (SECOND, 0.2))}),
        ("consensus", {"sensor": "position", "size": 0.2}, {effects.BIAS: but((3, 4), 0.0, ((ALL, slice(0, 2)), 0.2))}),
    ],
    "drop-out": [
        ("body", {"sensor": "gyro"}, {effects.MISSING: np.array([False, True, False])}),
        ("formation", {"agents": [2]}, {effects.MISSING: np.array([[False], [True], [False]])}),
        ("consensus", {"agents": [2], "sensor": "speed"}, {effects.MISSING: but((3, 2), 0, ((SECOND, 1), 1)) > 0}),
    ],
    "delay": [
        ("body", {"delay_s": 0.3}, {effects.AGE: np.array([0.3])}),
        ("formation", {"agents": [2], "delay_s": 0.3}, {effects.AGE: but((3, 1), 0.0, (SECOND, 0.3))}),
        ("consensus", {"agents": [2], "delay_s": 0.3}, {effects.AGE: but((3, 1), 0.0, (SECOND, 0.3))}),
    ],
    "message-loss": [
        ("formation", {"probability": 0.3}, {effects.LOSS: np.full(6, 0.3)}),
        ("consensus", {"probability": 0.3, "links": [[0, 3]]}, {effects.LOSS: np.array([0, 0, 0, 0, 0, 0.3])}),
    ],
    "message-delay": [
        ("formation", {"delay_s": 0.3}, {effects.MESSAGE_AGE: np.array([0.3])}),
        ("consensus", {"delay_s": 0.3}, {effects.MESSAGE_AGE: np.array([0.3])}),
    ],
    "cut": [
        ("formation", {"links": [[1, 2]]}, {effects.CUT: np.array([False, True, True, False, False, False])}),
        ("consensus", {"links": [[1, 0] if False else [0, 1]]}, {effects.CUT: np.array([True, False, False, False, False, False])}),
    ],
}
CASES = [(kind, where, keys, expected) for kind, cases in LAID.items() for where, keys, expected in cases]


def parts_of(where: str) -> Parts:
    return PLAIN if where == "plain" else PARTS[where]


def test_every_kind_is_tried_in_every_family_that_can_have_it():
    tried = {kind: {parts_of(where).family for where, *_ in cases} for kind, cases in LAID.items()}
    assert tried == {kind: set(event.families) for kind, event in KINDS.items()}


@pytest.mark.parametrize(("kind", "where", "keys", "expected"), CASES, ids=lambda case: case if isinstance(case, str) else "")
def test_a_fault_lays_down_what_it_says_while_it_lasts(kind, where, keys, expected):
    parts = parts_of(where)
    timeline = laid(fault(kind=kind, **keys), parts=parts)
    for effect, during in expected.items():
        found = values(timeline, effect)
        neutral = np.broadcast_to(effect.rest(parts), during.shape)
        np.testing.assert_allclose(found[10:30], np.broadcast_to(during, (20, *during.shape)), rtol=1e-15)
        for outside in (found[:10], found[30:]):
            np.testing.assert_array_equal(outside, np.broadcast_to(neutral, (len(outside), *during.shape)))
    assert [(one.trial, one.start_tick, one.end_tick, one.kind) for one in timeline.occurrences] == [(0, 10, 30, kind), (1, 10, 30, kind)]
    assert all(one.text and "\n" not in one.text for one in timeline.occurrences)
    assert values(timeline, effects.ACTIVE).nonzero()[0].tolist() == list(range(10, 30))


# shapes ---------------------------------------------------------------------------------------------------------------------

SINCE = DT * np.arange(20)
SHAPES = {
    "ramp": ({"shape": "ramp"}, SINCE / 2.0),
    "ramp, then steady": ({"shape": "ramp", "ramp_s": 0.5}, np.minimum(1.0, SINCE / 0.5)),
    "intermittent": ({"shape": "intermittent", "period_s": 0.5}, (np.arange(20) % 5 < 2.5).astype(float)),
    "rarely": ({"shape": "intermittent", "period_s": 1.0, "duty": 0.2}, (np.arange(20) % 10 < 2).astype(float)),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("kind", "where", "keys", "expected"), CASES, ids=lambda case: case if isinstance(case, str) else "")
def test_a_fault_grows_linearly_from_nothing_or_comes_and_goes(kind, where, keys, expected, shape):
    more, weight = SHAPES[shape]
    if more["shape"] not in KINDS[kind].shapes:
        with pytest.raises(ValueError, match=f"{kind} cannot be a {more['shape']}; it can be step or intermittent"):
            fault(kind=kind, **keys, **more)
        return
    parts = parts_of(where)
    timeline = laid(fault(kind=kind, **keys, **more), parts=parts)
    for effect, during in expected.items():
        neutral = np.broadcast_to(effect.rest(parts), during.shape)
        share = weight.reshape(-1, *[1] * during.ndim)
        found = values(timeline, effect)
        wanted = (share * during > 0) if effect.flag else share * during + (1.0 - share) * neutral
        np.testing.assert_allclose(found[10:30], wanted, rtol=1e-14, atol=1e-16)
        np.testing.assert_array_equal(found[30:], np.broadcast_to(neutral, (30, *during.shape)))
    assert values(timeline, effects.ACTIVE).nonzero()[0].tolist() == list(range(10, 30))


def test_a_ramp_that_the_end_of_the_run_cuts_off_has_not_grown_to_its_size():
    timeline = laid(fault(kind="bias", sensor="gyro", size=1.0, start_s=4.0, end_s=8.0, shape="ramp"))
    np.testing.assert_allclose(values(timeline, effects.BIAS)[40:, 3], np.arange(20) / 40)


def test_a_piecewise_constant_effect_is_kept_where_it_changes_alone():
    steady = fault(kind="effectiveness", wheel=1, remaining=0.5)
    assert laid(steady, trials=50).tracks[effects.DRIVE_GAIN].values.shape == (3, 1, 4)
    growing = fault(kind="effectiveness", wheel=1, remaining=0.5, shape="ramp", ramp_s=0.5)
    assert laid(growing, trials=50).tracks[effects.DRIVE_GAIN].values.shape == (8, 1, 4)
    drawn = fault(kind="effectiveness", wheel=1, remaining={"uniform": [0.2, 0.8]})
    assert laid(drawn, trials=50).tracks[effects.DRIVE_GAIN].values.shape == (3, 50, 4)


def test_a_periodic_torque_is_one_of_the_time_since_the_start_of_the_run():
    timeline = laid(fault(kind="periodic-torque", amplitude_nm=0.3, pulsation_rad_s=2.0), fault(kind="periodic-torque", amplitude_nm=0.1))
    time = DT * np.arange(TICKS)
    both = [a * np.stack([np.sin(p * time), np.cos(p * time), np.sin(2 * p * time)], axis=-1) for a, p in ((0.3, 2.0), (0.1, 1.0))]
    pushed = np.array([timeline.push(k)[0] for k in range(TICKS)])
    np.testing.assert_allclose(pushed[10:30], sum(both)[10:30], atol=1e-15)
    assert not pushed[:10].any()
    assert not pushed[30:].any()


def test_a_periodic_torque_by_agent_is_as_many_times_as_fast_as_the_agents_number_says():
    """Rososhansky 2017, sec. 4.2: 0.1 [sin(it), cos(it), sin(2it)]; another besides it has one pulsation for all."""
    own = fault(kind="periodic-torque", amplitude_nm=0.1, by_agent=True)
    shared = fault(kind="periodic-torque", amplitude_nm=0.3, agents=[3])
    timeline = laid(own, shared, parts=PARTS["formation"])
    time = DT * np.arange(10, 30)
    pushed = np.array([timeline.push(k)[0] for k in range(TICKS)])
    for i in (1, 2, 3):
        wanted = 0.1 * np.stack([np.sin(i * time), np.cos(i * time), np.sin(2 * i * time)], axis=-1)
        if i == 3:
            wanted += 0.3 * np.stack([np.sin(time), np.cos(time), np.sin(2 * time)], axis=-1)
        np.testing.assert_allclose(pushed[10:30, i - 1], wanted, atol=1e-15)
    assert not pushed[:10].any()
    assert not pushed[30:].any()


# draws ----------------------------------------------------------------------------------------------------------------------


def test_start_end_and_size_are_drawn_in_that_order_from_the_stream_of_the_fault():
    drawn = fault(kind="bias", sensor="gyro", start_s={"uniform": [1, 2]}, end_s={"uniform": [3, 5]}, size={"normal": [0, 1]})
    timeline = laid(fault(kind="float", wheel=1), drawn, trials=6)
    for trial in range(6):
        random = generator(5, trial, Stream.FAULT + 1)
        start, end = round(drawn.start_s.sample(random) / DT), round(drawn.end_s.sample(random) / DT)
        size = drawn.size.sample(random)
        found = values(timeline, effects.BIAS, trial)[:, 3]
        np.testing.assert_array_equal(found, np.where((np.arange(TICKS) >= start) & (np.arange(TICKS) < end), size, 0.0))
        assert timeline.occurrences[2 * trial + 1][:4] == (trial, start, end, "bias")


def test_a_trial_draws_the_same_whatever_the_batch():
    shaped = {"shape": "intermittent", "period_s": {"uniform": [0.3, 1.0]}, "duty": {"uniform": [0.2, 0.8]}}
    faults = (
        fault(kind="uniform-torque", amplitude_nm={"uniform": [1, 2]}, start_s={"uniform": [0, 3]}),
        fault(kind="external-torque", torque_nm={"uniform": [1, 2]}, **shaped),
        fault(kind="external-torque", torque_nm=1.0, agents=[1, 3]),
    )
    parts = PARTS["formation"]
    many = schedule([faults] * 8, parts, 5, np.arange(8), TICKS, DT)
    alone = schedule([faults], parts, 5, np.array([6]), TICKS, DT)
    pushed = np.array([many.push(k) for k in range(TICKS)])
    np.testing.assert_array_equal([alone.push(k)[0] for k in range(TICKS)], pushed[:, 6])
    assert len(np.unique(np.linalg.norm(pushed[15], axis=-1)[:, 0])) > 4
    assert [one[1:] for one in alone.occurrences] == [one[1:] for one in many.occurrences if one.trial == 6]


def test_trials_may_have_faults_of_their_own():
    one, other = fault(kind="bias", sensor="gyro", size=1.0), fault(kind="bias", sensor="gyro", size=2.0)
    timeline = schedule([(one,), (other,)], PARTS["body"], 5, np.arange(2), TICKS, DT)
    assert [values(timeline, effects.BIAS, trial)[15, 3] for trial in (0, 1)] == [1.0, 2.0]


# overlap --------------------------------------------------------------------------------------------------------------------


def test_the_later_of_two_that_say_different_things_is_heard_and_what_adds_up_adds_up():
    late = {"start_s": 2.0, "duration_s": 2.0}
    gain = values(laid(fault(kind="float", wheel=1), fault(kind="effectiveness", wheel=1, remaining=0.5, **late)), effects.DRIVE_GAIN)[:, 0]
    assert gain[[5, 15, 25, 35, 45]].tolist() == [1.0, 0.0, 0.0, 0.5, 1.0]
    dead = laid(fault(kind="constant-output", wheel=1, torque_nm=1.0), fault(kind="float", wheel=1, **late))
    assert values(dead, effects.DRIVE_OFFSET)[[15, 25, 35], 0].tolist() == [1.0, 0.0, 0.0]
    lossy = laid(fault(kind="message-loss", probability=0.3), fault(kind="message-loss", probability=0.1, **late), parts=PARTS["consensus"])
    assert values(lossy, effects.LOSS)[[15, 25, 35], 0].tolist() == [0.3, 0.1, 0.1]
    biases = laid(fault(kind="bias", size=1.0), fault(kind="noise", factor=2.0), fault(kind="noise", factor=3.0, bias=0.5, **late))
    assert values(biases, effects.BIAS)[[15, 25, 35], 0].tolist() == [1.0, 1.5, 0.5]
    assert values(biases, effects.NOISE)[[15, 25, 35], 0].tolist() == [2.0, 6.0, 3.0]
    whole = laid(fault(kind="inertia", add_kg_m2=[1, 1, 1]), fault(kind="inertia", inertia_kg_m2=[5, 5, 5, 0, 0, 0], **late))
    assert values(whole, effects.INERTIA)[[15, 25, 35], 0, 0].tolist() == [1.0, 5.0, 5.0]
    assert values(whole, effects.OWN_MASS)[[15, 25, 35], 0].tolist() == [1.0, 0.0, 0.0]


def test_what_has_no_end_lasts_until_the_next_of_its_kind_or_the_end_of_the_run():
    kinds = [{"start_s": 1.0, "gain": [3, 3]}, {"start_s": 4.0, "gain": [2, 2], "agents": [1]}]
    timeline = laid(*(FAULT.validate_python({"kind": "dynamics"} | one) for one in kinds), parts=PARTS["consensus"], trials=1)
    assert [(one.start_tick, one.end_tick) for one in timeline.occurrences] == [(10, 40), (40, TICKS)]
    assert values(timeline, effects.DYNAMICS)[50, :, 0].tolist() == [2.0, 3.0, 3.0]


# files ----------------------------------------------------------------------------------------------------------------------

SCENARIO = {
    "body": "nacs/fault-free",
    "plain": "monolithic/fault-free",
    "formation": "formation/fault-free",
    "testbeds": "formation/nacs",
    "consensus": "consensus/fault-free",
}
T = {"start_s": 1.0, "duration_s": 1.0}
LATE = {"start_s": 1.0, "end_s": 1e4}
BAD = [
    ("body", {"kind": "bias", "size": 1, "start_s": 1.0}, "give duration_s or end_s, one of the two"),
    ("body", {"kind": "bias", "size": 1, **T, "end_s": 3.0}, "give duration_s or end_s, one of the two"),
    ("body", {"kind": "bias", "size": 1, "start_s": 3.0, "end_s": 2.0}, "end_s = 2 is not after start_s = 3"),
    ("body", {"kind": "bias", "size": 1, "start_s": 3.0, "end_s": 3.0}, "end_s = 3 is not after start_s = 3"),
    ("consensus", {"kind": "dynamics", "gain": [1, 1], **T, "end_s": 3.0}, "give duration_s or end_s"),
    ("body", {"kind": "bias", "size": 1, "start_s": 99.5, "duration_s": 1.0}, "lasts from 99.5 to 100.5 s, the run from 0 to 100 s"),
    ("body", {"kind": "bias", "size": 1, "start_s": 100.0, "end_s": 101.0}, "begins at 100 s, the run ends at 100 s"),
    ("body", {"kind": "bias", "size": 1, **T, "shape": "square"}, "'step', 'ramp' or 'intermittent'"),
    ("body", {"kind": "bias", "size": 1, **T, "ramp_s": 1.0}, "ramp_s: is of shape = 'ramp' alone"),
    ("body", {"kind": "bias", "size": 1, **T, "duty": 0.5}, "duty: is of shape = 'intermittent' alone"),
    ("body", {"kind": "bias", "size": 1, **T, "shape": "intermittent"}, "an intermittent fault needs period_s"),
    ("body", {"kind": "bias", "size": 1, **T, "shape": "ramp", "ramp_s": 0}, "ramp_s: can be 0; must be positive"),
    ("body", {"kind": "bias", "size": 1, **T, "shape": "intermittent", "period_s": 1, "duty": 2}, "duty: can be 2; must be from 0 to 1"),
    ("body", {"kind": "drop-out", **T, "shape": "ramp"}, "drop-out cannot be a ramp; it can be step or intermittent"),
    ("body", {"kind": "bias", "size": 1, **T, "agents": [1]}, "the plant is one body; leave agents out"),
    ("body", {"kind": "periodic-torque", "amplitude_nm": 1, **T, "by_agent": True}, "the plant is one body; leave by_agent out"),
    ("formation", {"kind": "bias", "size": 1, **T, "agents": [7]}, "there is no agent 7; there are 6"),
    ("formation", {"kind": "bias", "size": 1, **T, "agents": []}, "needs 1 value or more"),
    ("formation", {"kind": "bias", "size": 1, **T, "sensor": "gyro"}, "there is no sensor 'gyro'; there are attitude, or 'all'"),
    ("plain", {"kind": "bias", "size": 1, **T, "sensor": "wheels"}, "there is no sensor 'wheels'"),
    ("plain", {"kind": "float", "wheel": 1, **T}, "the plant has no wheels"),
    ("formation", {"kind": "lock", "wheel": "all", **T}, "the agents have no wheels"),
    ("testbeds", {"kind": "lock", "wheel": 5, **T}, "there is no wheel 5; each agent has 4"),
    ("body", {"kind": "lock", "wheel": 5, **T}, "there is no wheel 5; wheels are 1 to 4 or 'all'"),
    ("consensus", {"kind": "float", "wheel": 1, **T}, "agents in the plane cannot have it; it is a fault of one body and a formation"),
    ("body", {"kind": "cut", "links": [[1, 2]], **T}, "one body cannot have it; it is a fault of a formation and agents in the plane"),
    ("consensus", {"kind": "cut", "links": [[1, 3]], **T}, "there is no link 1-3"),
    ("consensus", {"kind": "message-loss", "probability": 0.1, "links": [[1, 3]], **T}, "there is no link 1-3"),
    ("consensus", {"kind": "message-loss", "probability": 1.5, **T}, "probability: can be 1.5; must be from 0 to 1"),
    ("body", {"kind": "effectiveness", "wheel": 1, "remaining": -0.1, **T}, "remaining: can be -0.1; must be from 0 to 1"),
    (
        "body",
        {"kind": "constant-command", "axis": "x", "torque_nm": 1, **T},
        "turned by its wheels; constant-output is the fault of a wheel",
    ),
    ("plain", {"kind": "constant-command", "torque_nm": 1, **T}, "give one number and its axis, or three numbers and no axis"),
    ("plain", {"kind": "constant-command", "axis": "x", "torque_nm": [1, 2, 3], **T}, "give one number and its axis"),
    ("plain", {"kind": "constant-command", **T}, "give torque_nm, or force_n of agents in the plane"),
    ("consensus", {"kind": "constant-command", "torque_nm": [1, 2, 3], **T}, "give force_n"),
    ("body", {"kind": "inertia", **T}, "give inertia_kg_m2 or add_kg_m2, one of the two"),
    ("body", {"kind": "inertia", "add_kg_m2": [0, 0, 0], "centre_of_mass_um": [1, 0, 0], **T}, "add_kg_m2 keeps the centre of mass"),
    ("body", {"kind": "inertia", "add_kg_m2": [1, 0, 0], **T}, "no rigid body has its inertia with add_kg_m2"),
    ("formation", {"kind": "inertia", "add_kg_m2": [0, 0, {"uniform": [0, 99]}], **T}, "no rigid body has the inertia of agent 1"),
    ("formation", {"kind": "inertia", "inertia_kg_m2": [1, 1, 3, 0, 0, 0], "agents": [4], **T}, "no rigid body has the inertia of agent 4"),
    ("body", {"kind": "noise", **T}, "give factor or deviation, one of the two"),
    ("body", {"kind": "noise", "deviation": 1.0, **T}, "a body's sensors have several; give a factor"),
    ("consensus", {"kind": "drop-out", **T, "start_s": 0.0}, "the particles of loop mupf-b begin with a reading; let it begin later"),
    ("body", {"kind": "wheel-failure", "wheel": 1, **T}, "'wheel-failure'"),
]


@pytest.mark.parametrize(("where", "bad", "said"), BAD, ids=lambda case: case if isinstance(case, str) else "")
def test_what_a_file_gets_wrong_is_one_line(where, bad, said):
    with pytest.raises(BadInput) as refused:
        files.load(SCENARIO[where], {"faults": [bad]})
    line = str(refused.value)
    assert said in line
    assert f"{SCENARIO[where]}.toml: " in line
    assert "faults.0" in line
    assert "\n" not in line


OLDER = [
    ("plain", {"kind": "body-torque", "axis": "y", "torque_nm": 0.1}, {"kind": "constant-command"}),
    ("formation", {"kind": "command", "agents": [1], "torque_nm": [1, 2, 3]}, {"kind": "constant-command"}),
    ("formation", {"kind": "disturbance", "size_nm": 0.25}, {"kind": "periodic-torque", "amplitude_nm": 0.25}),
    ("formation", {"kind": "readings", "bias": 0.1, "deviation": 0.2}, {"kind": "noise"}),
    ("formation", {"kind": "delay", "delay_s": 0.2}, {"kind": "message-delay"}),
    ("formation", {"kind": "delay", "delay_s": 0.2, "agents": [2]}, {"kind": "delay"}),
    ("testbeds", {"kind": "wheel-failure", "agents": [2], "wheel": 1}, {"kind": "effectiveness", "remaining": 0.0}),
    ("consensus", {"kind": "command", "constant_n": 0.1}, {"kind": "constant-sliding"}),
    ("consensus", {"kind": "disturbance", "amplitude_n": 1, "rate_rad_s": 2}, {"kind": "disturbance-change"}),
    ("consensus", {"kind": "delay", "delay_s": 0.2}, {"kind": "message-delay"}),
]


@pytest.mark.parametrize(("where", "old", "new"), OLDER, ids=lambda case: case if isinstance(case, str) else "")
def test_older_names_are_still_read_and_written_as_todays(where, old, new):
    scenario = files.load(SCENARIO[where], {"faults": [old | {"start_s": 1.0, "end_s": 2.0}]})
    kept = {key: value for key, value in (old | new).items() if key != "size_nm"}
    plain = FAULT.validate_python(kept | {"start_s": 1.0, "end_s": 2.0})
    assert scenario.faults == (plain,)
    again = files.check(files.dumped(scenario), "again")
    assert again.faults == scenario.faults


def test_an_old_key_that_is_set_on_top_of_a_written_scenario_is_heard():
    scenario = files.load("formation/disturbance")
    changed = files.check(files.dumped(scenario), "changed", {"faults.0.size_nm": 0.5})
    assert changed.faults[0].amplitude_nm.constant == 0.5
    assert changed.faults[1:] == scenario.faults[1:]


def test_no_older_name_hides_a_kind_but_delay_of_readings():
    for family in FAMILIES:
        assert aliases(family).keys() & KINDS.keys() <= {"delay"}
    assert renamed("nonsense", "body") == "nonsense"
    assert renamed([1, {"kind": 3}], "body") == [1, {"kind": 3}]


def test_the_page_of_all_kinds_is_that_of_the_register():
    docs = Path(__file__).resolve().parents[1] / "docs"
    page = runpy.run_path(str(docs / "faults.py"))["PAGE"]
    assert (docs / "faults.md").read_text(encoding="utf-8") == page, "print it anew: python docs/faults.py > docs/faults.md"
    for kind in KINDS:
        assert f"| `{kind}` |" in page
