"""Mistakes that are planted in readings: what is said of each, and what the advised action gives."""

import json
from math import degrees, pi

import pytest
from support.documents import campaign, changed
from support.terminal import terminal

from jointstiff.simulator import TARGETS

OBSERVATIONS = "measurement_set.observations"


@pytest.fixture(scope="module")
def clean():
    places = {name: list(place) for name, place in TARGETS.items()}
    return changed(campaign(configurations=12, seed=8), ("measurement_set.flange_targets", places))


def each(document, key, change):
    """Change a part of every observation."""
    observations = [one | {key: change(one[key])} for one in document["measurement_set"]["observations"]]
    return changed(document, (OBSERVATIONS, observations))


def of_states(document, change):
    """Change the two positions of every reading."""
    return each(document, "readings", lambda rows: [row | change(row) for row in rows])


def columns_exchanged(document):
    return each(document, "joints", lambda q: [q[0], q[2], q[1], *q[3:]])


def load_point_and_target_exchanged(document):
    measured = document["measurement_set"]
    return changed(
        document,
        ("measurement_set.load_point", measured["flange_targets"]["P11"]),
        ("measurement_set.flange_targets.P11", measured["load_point"]),
    )


LIMITS = "check `units.angle`, the joint map, and the order of the joints"
SIGMA = (
    "check frames, joint map, units and noise; if all are correct, something besides the joints deflects: "
    "omit `noise` so that sigma is estimated from the residuals"
)
TURNED_ROUND = [
    (
        "force_sign_suspect",
        "do_not_use",
        "the work of the load on the joints is -49.6 J, but must be positive; the targets moved against the "
        "force in 12 of 12 observations",
        "change the sign of every force (it is the force on the robot); or exchange unloaded and loaded",
        "exchange_readings",
    ),
    (
        "no_joint_identified",
        "do_not_use",
        "the readings identify no joint: 6 at bound",
        "exchange unloaded and loaded readings, or change the sign of every force",
        "exchange_readings",
    ),
]
MISTAKES = {
    "degrees as radians": (
        lambda d: each(d, "joints", lambda q: list(map(degrees, q))),
        2,
        [
            (
                "angle_unit_suspect",
                "do_not_use",
                "the angles seem to be in deg, not in rad as declared: the largest one is 150.6 rad, more "
                "than two turns (and 1 more of this kind)",
                "set `units.angle` to deg",
                "convert_units",
            )
        ],
    ),
    "kilonewtons as newtons": (
        lambda d: each(d, "force", lambda f: [1e-3 * x for x in f]),
        6,
        [
            (
                "force_unit_suspect",
                "do_not_use",
                "the median force is 1.5 N, outside the plausible 5 N to 50000 N",
                "check `units.force`: kN read as N, or N as kN? (kgf read as N is not detected)",
                "convert_units",
            )
        ],
    ),
    "forces turned round": (lambda d: each(d, "force", lambda f: [-x for x in f]), 0, TURNED_ROUND),
    "states exchanged": (
        lambda d: of_states(d, lambda r: {"unloaded": r["loaded"], "loaded": r["unloaded"]}),
        0,
        TURNED_ROUND,
    ),
    "columns exchanged": (
        columns_exchanged,
        5,
        [
            (
                "alternative_explains_better",
                "do_not_use",
                "with the columns of joint_2 and joint_3 exchanged, the joints explain 98.6 % of the mean "
                "deflection instead of 83.4 %; the sum of squared residuals falls to 0.53 %",
                "check the columns of joint_2 and joint_3; if they are exchanged, exchange them back",
                "exchange_columns",
            ),
            (
                "joint_outside_limits",
                "use_with_care",
                "the model angle of joint_2 is -0.8979 rad, outside its limits [-0.6981, 1.222] rad (and 2 "
                "more of this kind)",
                LIMITS,
                "show_posture",
            ),
        ],
    ),
    "zero elsewhere": (
        lambda d: each(d, "joints", lambda q: [*q[:2], q[2] + pi / 2, *q[3:]]),
        3,
        [
            (
                "alternative_explains_better",
                "do_not_use",
                "with the zero of joint_3 offset by -90°, the joints explain 98.6 % of the mean deflection "
                "instead of 9.83 %; the sum of squared residuals falls to 0.022 %",
                "check where the controller's zero of joint_3 is; correct the joint map's offset",
                "apply_joint_map",
            ),
            (
                "target_off_model",
                "do_not_use",
                "target 'P12' is 3.71 m away from its median position on the flange (and 9 more of this "
                "kind)",
                "check that positions are in R0 and in `units.length`, the angles and their order, the joint "
                "map, and the robot's model",
                None,
            ),
            (
                "joint_outside_limits",
                "use_with_care",
                "the model angle of joint_3 is 1.66 rad, outside its limits [-1.745, 1.047] rad (and 4 more "
                "of this kind)",
                LIMITS,
                "show_posture",
            ),
        ],
    ),
    "millimetres as metres": (
        lambda d: of_states(d, lambda r: {s: [1e3 * x for x in r[s]] for s in ("unloaded", "loaded")}),
        5,
        [
            (
                "length_unit_suspect",
                "do_not_use",
                "the lengths seem to be in mm, not in m as declared: as posted, the targets keep one "
                "position "
                "on the flange in 1 of 12 observations; with all lengths divided by 1000, in 12 of 12, "
                "within "
                "59.6 µm",
                "set `units.length` to mm",
                "convert_units",
            )
        ],
    ),
    "load point and target exchanged": (
        load_point_and_target_exchanged,
        6,
        [
            (
                "alternative_explains_better",
                "do_not_use",
                "with every load point moved by (72.3, -65.1, 92.9) mm in the flange frame, the joints "
                "explain "
                "the readings better than chance allows (F test, p = 7e-48); a compliance changes by "
                "2.4e+02 %",
                "measure the load point on the flange",
                "fit_causes",
            ),
            (
                "residuals_exceed_sigma",
                "do_not_use",
                "the residuals are 4.22 times as large as the stated noise allows, so the uncertainties are "
                "too small; how much depends on what the model leaves unexplained",
                SIGMA,
                "omit_noise",
            ),
            (
                "load_at_target",
                "use_with_care",
                "the load point coincides with target 2, a reflector",
                "check the load point in the flange frame",
                "exchange_load_and_target",
            ),
        ],
    ),
    "noise far too small": (
        lambda d: changed(d, ("measurement_set.noise", {"sigma": 1e-7})),
        6,
        [
            (
                "residuals_exceed_sigma",
                "do_not_use",
                "the residuals are 188 times as large as the stated noise allows, so the uncertainties are "
                "too small; how much depends on what the model leaves unexplained",
                SIGMA,
                "omit_noise",
            ),
            (
                "sigma_suspect",
                "use_with_care",
                "distances between targets scatter by 27.7 µm, but the stated noise gives 141 nm",
                "check the stated noise and its unit; or omit `noise` so that sigma is estimated from the "
                "residuals",
                None,
            ),
        ],
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_each_mistake_is_said_with_what_remedies_it(local, clean, name):
    mistake, identified, reasons = MISTAKES[name]
    body = mistake(clean) | {"run": {"elasticity": "joints"}}
    run = local.request("POST", "/v1/campaigns", json=body).json()
    assessment = run["result"]["assessment"]
    assert (assessment["verdict"], assessment["joints_identified"]) == ("do_not_use", identified)
    assert [
        (one["code"], one["weight"], one["message"], one["remedy"], one["action"] and one["action"]["kind"])
        for one in assessment["reasons"]
    ] == reasons
    assert "If N and kgf are confused, every stiffness is wrong by 9.81" in assessment["notes"][0]
    action = assessment["reasons"][0]["action"]
    answer = local.request("POST", f"/v1/runs/{run['id']}/apply", json=action)
    assert answer.status_code == 201, answer.text
    mended = answer.json()["result"]["assessment"]
    stays = {
        "load point and target exchanged": "use_with_care",  # a cause that was fitted stays on record
        "noise far too small": "use_with_care",
    }
    assert (mended["verdict"], mended["joints_identified"]) == (stays.get(name, "use"), 6)


def test_the_terminal_shows_numbers_before_and_after_an_action(tmp_path, clean):
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(columns_exchanged(clean)))

    def applied(action):
        return terminal("identify", file, "--elasticity", "joints", "--apply", action, width=120)

    first, again, unknown = map(applied, ("exchange_columns", "exchange_columns", "dance"))
    words = " ".join(first.output.split())
    for line in [
        "Before and after",
        "│ verdict │ do not use │ use │",
        "│ explained │ 83.4 % │ 98.6 % │",
        "│ rms residual │ 609 µm │ 44.7 µm │",
        "│ joint_1 │ 2.868 ± 0.043 │ 3.816 ± 0.057 │",
        "│ joint_4 │ rigid ± — │ 0.436 ± 0.027 │",
        "stiffness with its standard uncertainty in 10⁶ N·m/rad",
        "Use: all 6 joints passed the checks",
        "│ joint_5 │ 0.2531 │ 0.0080 │ 0.2383 … 0.2699 │ determined │",
    ]:
        assert line in words
    written = tmp_path / "wrong-exchange-columns.json"
    assert first.exit_code == 0
    assert "".join(first.stderr.split()) == f"wrote{written}"
    assert json.loads(written.read_text())["measurement_set"]["observations"][0]["joints"] == pytest.approx(
        clean["measurement_set"]["observations"][0]["joints"]
    )
    assert again.exit_code == unknown.exit_code == 2
    assert "".join(again.stderr.split()) == (f"{written}existsremedy:chooseanothername,or--overwrite")
    assert " ".join(unknown.stderr.split()) == (
        "apply: the assessment does not advise 'dance' remedy: give one of: exchange_columns"
    )
