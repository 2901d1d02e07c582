"""Measuring live from Python and the terminal: an exact arm, goals in words, sources over real lines."""

import asyncio
import json
import os
import socket
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Self

import numpy as np
import pytest
from support.live import positions
from support.terminal import terminal

import jointstiff
from jointstiff.schemas.robot import RobotDocument
from jointstiff.service.conversion.prepared import prepare_robot
from jointstiff.service.live import sources
from jointstiff.service.live.sources import (
    CheckedSource,
    Lines,
    RoboDk,
    Setting,
    Simulated,
    SourceError,
    Stand,
)
from jointstiff.simulator import LOAD_POINT, TARGETS, default_arm, robot_document, simulate_campaign

ARM = default_arm()


@pytest.fixture(scope="module")
def campaign():
    return simulate_campaign(ARM, configurations=8, load="dead_weight", seed=1)


def setting(sigma=2e-5):
    """Where a source reads."""
    robot = prepare_robot(RobotDocument.model_validate(robot_document(ARM))).robot
    return Setting(robot, {name: tuple(place) for name, place in TARGETS.items()}, tuple(LOAD_POINT), sigma)


@pytest.mark.parametrize("loaded", [False, True])
def test_a_simulated_arm_balances_its_load_exactly(loaded):
    """Its readings are those of springs that share no code with it, within noise that is next to none."""
    source, joints, force = Simulated("3"), (0.3, 0.2, -0.4, 0.5, 0.8, -1.0), (300.0, -400.0, -1500.0)

    async def read():
        await source.open(setting(sigma=1e-12))
        await source.stand(Stand("m01", joints, force, loaded))
        return [(await source.point(name))[0] for name in TARGETS]

    points = np.array(asyncio.run(read()))
    arm = replace(ARM, stiffnesses=source.stiffness)
    expected = positions(arm, joints, force, sigma=0.0)["loaded" if loaded else "unloaded"]
    assert np.abs(points - expected).max() < 1e-9
    assert ((source.stiffness > 1e4) & (source.stiffness < 3e7)).all()


@pytest.mark.parametrize(
    "goal", ["40 um", *(pytest.param(goal, marks=pytest.mark.slow) for goal in ("15 %", "below 5 mm"))]
)
def test_a_campaign_is_measured_by_its_source_until_its_goal_is_reached(campaign, goal):
    with jointstiff.measure(campaign, goal=goal, source="simulated:1") as live:
        state = live.run_source()
        assert state.state == "reached"
        assert 5 <= live.count <= 20
        assert live.state.readings[-1].ball_ratio <= 1.0
        for joint, stiffness in zip(state.joints, live.source.stiffness, strict=True):
            if joint.relative is not None:
                assert abs(joint.stiffness / stiffness - 1.0) <= 2.0 * joint.relative_with_assumed
        run = live.close()
    assert run.state == "succeeded"
    assert len(live.campaign.measurement_set.observations) == live.count
    assert "Measured live" in live.campaign.measurement_set.notes


def test_a_mistake_at_the_first_reading_is_withdrawn_once_the_others_show_it(campaign):
    """Targets exchanged by hand, before a source reads the rest."""
    with jointstiff.measure(campaign, goal="15 %", source="simulated:1") as live:
        stiffness = sources.draw_plausible_stiffness(setting().robot, np.random.default_rng(1))
        first, arm = live.next, replace(ARM, stiffnesses=stiffness)
        places = positions(arm, first.joints, first.force, sigma=2e-5)
        order = ["P11", "P10", *list(TARGETS)[2:]]
        live.observe(*(dict(zip(order, (1e3 * each).tolist(), strict=True)) for each in places.values()))
        state = live.run_source()
    assert state.state == "reached"
    withdrawn = {each.label: each.reason for each in state.readings if each.state == "withdrawn"}
    assert withdrawn == {"m01": "a mistake, as later readings show"}


@pytest.mark.slow
def test_a_target_that_slips_in_every_reading_ends_the_campaign(campaign, monkeypatch):
    """No single reading is the mistake: one is withdrawn at most, and nobody measures for ever."""

    class Slipping(Simulated):
        async def stand(self, stand):
            await super().stand(stand)
            if stand.loaded:
                self._places["P10"] = self._places["P10"] + np.array([3e-3, 0.0, 0.0])

    monkeypatch.setattr(sources, "Simulated", Slipping)
    with jointstiff.measure(campaign, goal="15 %", source="simulated:1") as live:
        state = live.run_source()
    assert state.state == "cannot"
    assert [each.state for each in state.readings].count("counts") <= 11
    assert sum(each.reason == "a mistake, as later readings show" for each in state.readings) <= 1


ARM = default_arm()
STAND = Stand("m01", (0.3, 0.2, -0.4, 0.5, 0.8, -1.0), (0.0, 0.0, -1500.0), loaded=False)
ASK = "{state} {target} {joints} {force}"
Answer = Callable[[int, str], str]


class Tracker:
    """A laser tracker beside an exact arm: answers a line for each request over TCP."""

    def __init__(self, spoilt: Answer = lambda _, line: line) -> None:
        self._spoilt, self._asked = spoilt, 0
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)  # which wakes who accepts; closing alone would not
        self._thread.join()
        self._socket.close()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            with connection, connection.makefile("rw", encoding="utf-8") as lines:
                for line in lines:
                    answer = self._answer(line)
                    if answer == "end":
                        break
                    for part in (answer[:9], answer[9:]):  # a line may come in pieces
                        lines.write(part)
                        lines.flush()

    def _answer(self, line: str) -> str:
        state, target, *numbers = line.split()
        values = [float(number) for number in numbers]
        place = (
            1e3
            * positions(ARM, values[:6], values[6:], sigma=2e-5, seed=self._asked)[state][
                list(TARGETS).index(target)
            ]
        )
        self._asked += 1
        return self._spoilt(self._asked, f"{target}; {place[0]:.9f}; {place[1]:.9f}; {place[2]:.9f}\n")


@pytest.mark.parametrize(
    "options",
    [{}, {"columns": "target,x,y,z"}, {"pattern": r"(?P<target>\w+); (?P<x>\S+); (?P<y>\S+); (?P<z>\S+)"}],
)
def test_a_tracker_is_read_over_tcp_until_the_goal_is_reached(campaign, options):
    with Tracker() as tracker:
        lines = options | {"request": ASK}
        source = f"lines:tcp://127.0.0.1:{tracker.port}"
        with jointstiff.measure(campaign, "15 %", source, source_options=lines) as live:
            if options:
                assert live.run_source(most=1).readings[0].state == "counts"
                return
            assert live.run_source().state == "reached"
            for joint, stiffness in zip(live.state.joints, ARM.stiffnesses, strict=True):
                if joint.relative is not None:
                    assert abs(joint.stiffness / stiffness - 1.0) <= 2.0 * joint.relative_with_assumed


def jumping(count: int, line: str) -> str:
    name, x, y, z = line.split(";")
    return line if count <= 6 else f"{name}; {float(x) + 300.0}; {y}; {z}"


def in_metres(line: str) -> str:
    """Return a line `target; x; y; z` in mm with its lengths in m."""
    name, *place = line.replace(";", " ").split()
    return " ".join([name, *(repr(float(part) / 1e3) for part in place)]) + "\n"


SPOILT: dict[str, tuple[Answer, str]] = {
    "jumps": (jumping, "jumped"),
    "metres": (
        lambda count, line: in_metres(line) if count > 6 else line,
        "within 0.1 m if the source's lengths are in m, not in mm: .*`--source-unit m`",
    ),
    "stops": (lambda count, line: line if count <= 6 else "", "sent nothing for 1 s"),
    "ends": (lambda count, line: line if count <= 6 else "end", "stopped"),
    "rubbish": (lambda count, line: line if count <= 6 else "ERR 17\n" * 20, "contain no reading"),
    "exchanged": (
        lambda count, line: line.replace("P10", "P1X") if count > 6 else line,
        "sent nothing of the next target for 1 s, but positions of other names: P1X",
    ),
    "binary": (lambda count, line: line if count <= 6 else "\x00\x1b[2J\ufffd\n" * 20, "contain no reading"),
}


@pytest.mark.parametrize("spoilt", SPOILT)
def test_what_is_no_reading_is_said_and_does_not_count(campaign, spoilt):
    answer, words = SPOILT[spoilt]
    with Tracker(answer) as tracker:
        source = f"lines:tcp://127.0.0.1:{tracker.port}"
        lines = {"request": ASK, "sample": False}
        with jointstiff.measure(campaign, "15 %", source, timeout=1.0, source_options=lines) as live:
            with pytest.raises(SourceError, match=words):
                live.run_source()
            assert live.count == 1
            assert all(each.state == "counts" for each in live.state.readings)


def test_the_unit_that_is_named_for_a_source_is_the_remedy(campaign):
    with Tracker(lambda _count, line: in_metres(line)) as tracker:
        lines = {"request": ASK, "sample": False, "source_unit": "m"}
        source = f"lines:tcp://127.0.0.1:{tracker.port}"
        with jointstiff.measure(campaign, "15 %", source, source_options=lines) as live:
            live.run_source(most=1)
            assert live.count == 1


def test_a_line_among_rubbish_is_read_and_the_rubbish_said(campaign):
    said: list[str] = []
    with Tracker(lambda count, line: f"# {count}\n{line}") as tracker:
        lines = {"request": ASK, "warn": said.append}
        source = f"lines:tcp://127.0.0.1:{tracker.port}"
        with jointstiff.measure(campaign, "15 %", source, source_options=lines) as live:
            live.run_source(most=1)
            assert live.count == 1
    assert len(said) == 6
    assert "'# 1' is not a reading" in said[0]


def test_udp_is_listened_to_and_what_came_before_does_not_count():
    """Datagrams of an earlier posture are forgotten; of another sender they never count."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    places = positions(ARM, STAND.joints, STAND.force, sigma=2e-5)["unloaded"]

    async def read():
        source = Lines(f"udp://127.0.0.1:{port}", sample=False, columns="target,x,y,z", source_unit="m")
        checked = CheckedSource(source, setting(), 5.0)
        await checked.open()
        with (
            socket.socket(type=socket.SOCK_DGRAM) as sender,
            socket.socket(type=socket.SOCK_DGRAM) as stranger,
        ):
            stranger.bind(("127.0.0.2", 0))
            send = lambda text: sender.sendto(text.encode(), ("127.0.0.1", port))  # noqa: E731
            for name in TARGETS:
                send(f"{name} 9 9 9")
            await asyncio.sleep(0.1)
            reading = asyncio.ensure_future(checked.read(STAND))
            await asyncio.sleep(0.1)
            for name, place in reversed(list(zip(TARGETS, places.tolist(), strict=True))):
                send(f"{name},{place[0]!r},{place[1]!r},{place[2]!r}")
                for other in TARGETS:
                    stranger.sendto(f"{other},9,9,9".encode(), ("127.0.0.1", port))
            points = await reading
        await checked.close()
        return points

    points = asyncio.run(read())
    assert {name: place for name, (place, _) in points.items()} == {
        name: tuple(place) for name, place in zip(TARGETS, places.tolist(), strict=True)
    }


def test_a_serial_line_is_read_and_hangs_up():
    master, slave = os.openpty()
    places = positions(ARM, STAND.joints, STAND.force, sigma=2e-5)["unloaded"]

    async def read():
        checked = CheckedSource(Lines(os.ttyname(slave), sample=False, columns="x,y,z,sigma"), setting(), 5.0)
        await checked.open()
        reading = asyncio.ensure_future(checked.read(STAND))
        await asyncio.sleep(0.1)
        for place in places:
            os.write(master, (" ".join(f"{1e3 * part:.6f}" for part in place) + " 0.03\r\n").encode())
        points = await reading
        os.close(slave)
        os.close(master)
        with pytest.raises(SourceError, match=r"stopped|reached"):
            await checked.read(STAND)
        await checked.close()
        return points

    points = asyncio.run(read())
    assert np.allclose([place for place, _ in points.values()], places, atol=1e-9)
    assert [sigma for _, sigma in points.values()] == pytest.approx([3e-5] * len(TARGETS))


class Shown:
    """A source that shows places of its own, as packages of others have it: `point` alone."""

    def __init__(self, *places) -> None:
        self._places = [place for each in places for place in each]

    async def point(self, _name):
        place = self._places.pop(0)
        return place if len(place) == 2 else (tuple(place), None)


THERE = positions(ARM, STAND.joints, STAND.force, sigma=0.0)["unloaded"]
UP = np.array([0.0, 0.6, 0.8])
LONGER = np.outer([0.0, 1.0, 0.0], THERE[1] - THERE[0]) / np.linalg.norm(THERE[1] - THERE[0])


def shown(*stands, where=None):
    """Read targets as a source shows them, with the load in all postures but the first."""

    async def read():
        checked = CheckedSource(Shown(*stands), where or setting(), 5.0)
        return [await checked.read(replace(STAND, loaded=i > 0)) for i, _ in enumerate(stands)]

    return asyncio.run(read())


@pytest.mark.parametrize(
    ("kept", "refused", "words"),
    [
        (
            [THERE + 0.099 * UP],
            [THERE + 0.101 * UP],
            "P10 is 0.101 m from the position that the robot's joint values give; up to 0.1 m is plausible",
        ),
        (
            [THERE + 0.009 * LONGER],
            [THERE + 0.011 * LONGER],
            "P11 is .* a difference up to 10 mm is plausible",
        ),
        (
            [THERE, THERE - 0.049 * UP],
            [THERE, THERE - 0.051 * UP],
            "P10 is 51 mm from its position without load; up to 50 mm is plausible",
        ),
        (
            [THERE, THERE + 1e-9],
            [THERE, THERE],
            "P10: the source sent exactly the same position as in an earlier reading",
        ),
        ([THERE], [THERE[[0, 0]]], "P11: the source sent exactly the same position as in an earlier reading"),
    ],
    ids=["astray", "longer", "deflected", "repeated", "one for another"],
)
def test_a_reading_is_refused_beyond_its_bound_and_kept_within(kept, refused, words):
    """Bounds of 100 mm from the robot's place, 10 mm of two targets' distance, and 50 mm under a load."""
    for points, places in zip(shown(*kept), kept, strict=True):
        np.testing.assert_array_equal([place for place, _ in points.values()], places)
    with pytest.raises(SourceError, match=words):
        shown(*refused)


def test_what_is_no_position_is_refused():
    rubbish = [(tuple(THERE[0]), sigma) for sigma in (0.0, -1e-5, 1.0, np.nan)]
    rubbish += [np.roll([part, 1.0, 1.0], k) for part in (-100.1, 100.1, np.inf, np.nan) for k in range(3)]
    for point in rubbish:
        with pytest.raises(SourceError, match="cannot be the position of a target"):
            shown([point])


def test_readings_in_another_frame_are_looked_for_there():
    """The tracker's frame is turned by 90° about z, and stands at (4, -1, 0.5) m."""
    turn, station = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([4.0, -1.0, 0.5])
    where = replace(setting(sigma=1e-12), frame=(turn, station))
    read = (THERE - station) @ turn  # the inverse of a rotation is its transpose
    assert len(shown(read, where=where)[0]) == len(TARGETS)
    np.testing.assert_allclose([where.from_base(place) for place in THERE], read, atol=1e-12)
    with pytest.raises(SourceError, match=r"0\.101 m from the position"):
        shown(read + 0.101 * UP, where=where)


def test_a_tracker_may_have_its_origin_at_a_target():
    """In R0 such positions are in a wrong unit; of a tracker's frame nothing is known."""
    document = simulate_campaign(default_arm(), load="pull", configurations=3, seed=1)
    stated = document["measurement_set"]
    origin = np.array(stated["observations"][0]["readings"][0]["unloaded"])
    stated["frame"] = {"rotation": np.eye(3).tolist(), "translation": origin.tolist()}
    for observation in stated["observations"]:
        (reading, *_) = observation["readings"]
        read = {name: (np.array(reading[name]) - origin).tolist() for name in ("unloaded", "loaded")}
        observation["readings"] = [{"target": "P10"} | read]
    with jointstiff.measure(document, goal="15 %", source=None) as live:
        for observation in stated["observations"]:
            (reading,) = observation["readings"]
            unloaded, loaded = ({"P10": 1e3 * np.array(reading[name])} for name in ("unloaded", "loaded"))
            joints, force = np.degrees(observation["joints"]), observation["force"]
            state = live.observe(unloaded, loaded, label=observation["label"], joints=joints, force=force)
    assert [each.state for each in state.readings] == ["counts"] * 3


def test_robodk_measures_targets_where_the_robot_holds_them(monkeypatch):
    """A station whose tracker sees P10 and P11 a millimetre above their places, and no other target."""

    left = iter((2, 1))

    def measure(expected, _search):
        return [*expected[:2], expected[2] + 1.0] if next(left, 0) else None

    link = SimpleNamespace(LaserTracker_Measure=measure)
    module = SimpleNamespace(robolink=SimpleNamespace(Robolink=lambda: link))
    monkeypatch.setitem(sys.modules, "robodk", module)

    async def read():
        source = RoboDk()
        await source.open(setting())
        await source.stand(STAND)
        points = [(await source.point(name))[0] for name in ("P10", "P11")]
        with pytest.raises(SourceError, match="did not find P12"):
            await source.point("P12")
        return points

    places = positions(ARM, STAND.joints, STAND.force, sigma=0.0)["unloaded"]
    np.testing.assert_allclose(asyncio.run(read()), np.add(places[:2], [0.0, 0.0, 1e-3]), atol=1e-9)


def test_the_profile_is_shown_and_confirmed(campaign, tmp_path):
    path = tmp_path / "campaign.json"
    path.write_text(json.dumps(campaign))
    with Tracker() as tracker:
        source = f"lines:tcp://127.0.0.1:{tracker.port}"
        arguments = [str(path), "--goal=15 %", f"--source={source}", f"--request={ASK}", "--json", "--most=2"]
        unanswered = terminal("measure", *arguments)
        assert unanswered.exit_code == 2
        assert "confirm" in unanswered.stderr
        assert "as [target] x y z, lengths in mm" in unanswered.stderr
        assert not unanswered.stdout
        confirmed = terminal("measure", *arguments, input="y\n")
        assert confirmed.exit_code == 0, confirmed.stderr
        assert json.loads(confirmed.stdout)["readings"] == 2
        assert terminal("measure", *arguments, "--yes").exit_code == 0
