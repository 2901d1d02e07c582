"""What the terminal shows of runs with options: priors, methods, signs, coupled joints."""

import json

import pytest
from support.cases import campaign as recorded
from support.documents import campaign
from support.terminal import terminal

UNSEEN = "joint_1: the load never twists this joint: add loads that twist the joint"
PRIOR = "the prior is not returned as a result, because the readings do not determine the joint"
TO_DO = "To do 1. joint_1: 1500 N along (0.50, 0.87, 0.00) in posture c05"
TO_DO_OF_OTHER_METHODS = "To do 1. joint_1: 1500 N along (0.34, 0.94, 0.00) in posture c10"
FIVE = "Use 5 of 6 joints: no number of the other joints passed the checks"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaigns")
    (folder / "hung.json").write_text(json.dumps(campaign("dead_weight", 12, 2)))
    (folder / "beam.json").write_text(json.dumps(recorded("beam") | {"run": {}}))
    return folder


@pytest.mark.parametrize(
    ("options", "lines"),
    [
        (
            "--prior joint_1=3e6:3e5",
            [
                FIVE,
                "Joint stiffness, partial pose, covariance weights, compliance ≥ 0",
                "┃ joint ┃ stiffness ┃ 95 % interval ┃ prior/data ┃ verdict ┃",
                "│ joint_1 │ — │ — │ — │ not observable │",
                "│ joint_2 │ 3.112 │ 3.042 … 3.185 │ — │ well determined │",
                "│ joint_6 │ 0.0962 │ 0.0795 … 0.1155 │ — │ determined │",
                f"{UNSEEN}; {PRIOR} assumed: load point ± 10 mm, force ± 1 %; --details",
                TO_DO,
            ],
        ),
        (
            "--prior joint_1=3e6:3e5 --prior joint_2=2e6:1e4 --details",
            [
                "Do not use: 2 reasons the residuals are 3.55 times as large as the stated noise allows, so "
                "the uncertainties are too small; how much too small depends on the deflections that the "
                "model does "
                "not explain. Targets of one posture agree to within 18.6 µm, so the flange moves "
                "differently from the model",
                "│ joint_2 │ 2.550 │ 2.514 … 2.586 │ 0.65 │ do not use │",
                "│ joint_3 │ 2.624 │ 2.552 … 2.699 │ — │ do not use │",
                f"{UNSEEN}; {PRIOR}",
                "explains 96.2 % of the mean deflection, residual 146 µm rms (3-D)",
                "χ²/dof 12.60: residuals larger than sigma predicts (1 if model and sigma are right; 103.4 "
                "degrees of freedom)",
                "uncertainty from readings (type B): ± 0.72 to 10 % of a compliance",
                "uncertainty from scale of the force, 1 % assumed (type B): ± 0.065 to 2.2 % of a compliance",
                "uncertainty from load point, 10 mm assumed (type B): ± 0.33 to 37 % of a compliance",
                "uncertainty from model error (type A, not in the intervals): ± 0.75 to 8.8 %",
                "complementary stiffness included (9 refits); it changes a compliance by at most 0.41 std. "
                "uncertainties (K_c/k at most 0.0044)",
                "causes tested with the joints, p-value: play 0.6, curved springs 0.6, load zero 0.7",
                "observability O1 0.57, O2 0.21, O3 0.26, O4 0.057, O5 0.1; condition number 3.94",
                "or repeat the command with `--apply omit_noise`",
                "│ Priors │ joint_1 stiffness 3 10⁶ N·m/rad, standard uncertainty 0.3 10⁶ N·m/rad; joint_2",
            ],
        ),
        (
            "--method decoupled_partial_pose",
            [
                FIVE,
                "Joint stiffness, decoupled partial pose, covariance weights, compliance ≥ 0",
                "│ joint_2 │ 3.125 │ 3.050 … 3.205 │ well determined │",
                "│ joint_4 │ 0.431 │ 0.382 … 0.495 │ determined │",
                UNSEEN,
                TO_DO_OF_OTHER_METHODS,
            ],
        ),
        (
            "--no-positive",
            [
                FIVE,
                "Joint stiffness, partial pose, covariance weights, unconstrained",
                "│ joint_2 │ 3.112 │ 3.042 … 3.185 │ well determined │",
                f"{TO_DO}: the interval becomes ± 0.0037 µrad/(N·m)",
            ],
        ),
        (
            "--positive --method complete_pose --weighting characteristic_length --characteristic-length 500 "
            "--details",
            [
                FIVE,
                "Joint stiffness, complete pose, characteristic_length weights, compliance ≥ 0",
                "│ joint_3 │ 2.481 │ 2.408 … 2.559 │ well determined │",
                "│ joint_5 │ 0.2607 │ 0.2432 … 0.2809 │ determined │",
                "residual 45.3 µm rms (3-D)",
            ],
        ),
    ],
)
def test_options_change_numbers_title_and_what_is_to_do(folder, options, lines):
    result = terminal("identify", folder / "hung.json", "--elasticity", "joints", *options.split(), width=120)
    words = " ".join(result.stdout.split())
    assert result.exit_code == 0
    for line in lines:
        assert line in words


def test_coupled_joints_of_an_arm_whose_links_bend_are_not_to_be_used(folder):
    options = ("--elasticity", "coupled_joints", "--link-penalty", 1)
    words = " ".join(terminal("identify", folder / "beam.json", *options, width=120).stdout.split())
    for line in [
        "Do not use: 4 reasons the residuals are 21.4 times as large as the stated noise allows",
        "│ joint_1 │ 0.9606 │ no interval │ do not use │",
        "│ joint_5 │ 0.2448 │ no interval │ do not use │",
        "│ joint_6 │ 0.8426 │ no interval │ uncertain │",
        "joint_6: poorly determined (standard uncertainty 383 %): bending links explain the readings nearly "
        "as well as this joint",
        "coupled joints with loss squared explain 73.4 % of held-out postures, joints alone 73.4 %; simplest "
        "good model: joints",
        "1 more reason; --details",
    ]:
        assert line in words


@pytest.fixture
def bare(tmp_path):
    """A campaign of a bare URDF, which states no payload."""
    document = campaign("pull", 8, 2)
    file = tmp_path / "bare.json"
    robot = {name: part for name, part in document["robot"].items() if name != "payload"}
    file.write_text(json.dumps(document | {"robot": robot}))
    return file


def test_a_payload_is_requested_and_kept_with_the_robot_of_the_corrected_campaign(bare):
    before = terminal("identify", bare, "--elasticity", "joints", width=120)
    assert "or repeat the command with `--payload KG`" in " ".join(before.stdout.split())
    after = terminal("identify", bare, "--elasticity", "joints", "--payload", "240", width=120)
    assert after.exit_code == 0
    assert "--payload" not in after.stdout
    written = bare.with_name("bare-state-payload.json")
    assert json.loads(written.read_text())["robot"]["payload"] == 240.0
    again = terminal("identify", written, "--elasticity", "joints", width=120)
    assert "payload" not in again.stdout


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--payload", "0"], "a payload of 0 kg is not plausible"),
        (["--payload", "240", "--apply", "omit_noise"], "belongs to no action omit_noise"),
    ],
)
def test_a_payload_that_is_none_or_of_another_action_is_refused(bare, options, reason):
    result = terminal("identify", bare, "--elasticity", "joints", *options)
    assert result.exit_code == 2
    assert reason in " ".join(result.stderr.split())
