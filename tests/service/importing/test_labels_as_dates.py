"""Labels that a spreadsheet turned into dates are named; other labels that differ are not."""

import pytest

import jointstiff as js

POINTS = "label;target;state;x [mm];y [mm];z [mm]\n"
JOINTS = "label;J1 [deg];J2 [deg];Fx [N];Fy [N];Fz [N]\n"
MONTHS = ["Jan", "Feb", "Mrz"]


def import_labels(folder, labels):
    """Import joints with some labels, and points with the labels 1-1, 1-2 and 1-3."""
    joints = "".join(f"{label};{i};{2 * i};0;0;-100\n" for i, label in enumerate(labels))
    points = "".join(
        f"1-{i};P1;{state};{1000 + i};0;{500 - k}\n"
        for i in range(1, 4)
        for k, state in enumerate(("unloaded", "loaded"))
    )
    (folder / "joints.csv").write_text(JOINTS + joints)
    (folder / "points.csv").write_text(POINTS + points)
    options = {"encoders": "motor", "load_point": (0, 0, 100)}
    return js.import_files(folder / "joints.csv", folder / "points.csv", **options)


@pytest.mark.parametrize("form", ["01. {}", "1-{}", "{}-01", "1 {}"])
def test_dates_of_a_spreadsheet_are_named_with_the_labels_to_write(form, tmp_path):
    with pytest.raises(js.CampaignError) as refused:
        import_labels(tmp_path, [form.format(month) for month in MONTHS])
    answer = str(refused.value)
    assert f"turned labels such as '1-1' into dates such as '{form.format('Jan')}'" in answer
    assert "write the labels again: '1-1', '1-2', '1-3'" in answer
    assert len(import_labels(tmp_path, ["1-1", "1-2", "1-3"]).measurement_set.observations) == 3


def test_other_labels_are_no_dates(tmp_path):
    with pytest.raises(js.CampaignError) as refused:
        import_labels(tmp_path, ["pose-01", "pose-02", "pose-03"])
    assert "dates" not in str(refused.value)
