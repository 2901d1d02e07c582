"""Files of poses over HTTP, and more rows than are corrected at once: jobs with the numbers of Python."""

import io
import json
import time

import httpx2
import numpy as np
import pandas
import pyarrow
import pytest
from pyarrow import parquet
from support.api import file_at, job_at, posted
from support.programs import FORCE, TOOL, path, tool_poses

import jointstiff as js
from jointstiff.simulator import default_arm, simulate_campaign

CAMPAIGN = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
TOOL_IN_MM = [*(1e3 * TOOL), 0.0, 0.0, 0.0]
ROWS = 5_020
JOINTS = path(ROWS)
POSES = tool_poses(JOINTS)
POSES[:, :3, 3] *= 1e3
OPTIONS = {"units": {"length": "mm", "angle": "deg", "force": "N"}, "tool": TOOL_IN_MM, "force": list(FORCE)}
NUMBERS = [f"{axis} [mm]" for axis in ("x", "y", "z", "dx", "dy", "dz")]
NUMBERS += [f"J{number} [deg]" for number in range(1, 7)]


@pytest.fixture(scope="module")
def run(service):
    with httpx2.Client(base_url=service.url, timeout=60.0) as client:
        return posted(client, CAMPAIGN)


@pytest.fixture(scope="module")
def here():
    return js.correct(CAMPAIGN, POSES, np.degrees(JOINTS), tool=TOOL_IN_MM, forces=FORCE)


@pytest.fixture(scope="module")
def sent():
    """The poses with joints as a table with labels."""
    vectors = (
        js.correct(CAMPAIGN, POSES, np.degrees(JOINTS), tool=TOOL_IN_MM, forces=(0, 0, 0))
        .to_frame()
        .reset_index(drop=True)
    )
    poses = [f"{axis} [mm]" for axis in "xyz"] + [f"r{axis} [deg]" for axis in "xyz"]
    table = vectors[poses + [f"J{number} [deg]" for number in range(1, 7)]]
    return pandas.DataFrame({"label": [f"P{i}" for i in range(1, ROWS + 1)]}).join(table)


def packed(table, ending):
    content = io.BytesIO()
    if ending == "csv":
        table.to_csv(content, index=False)
    else:
        table.to_parquet(content, index=False)
    return content.getvalue()


def post_file(client, run, content, name="poses.csv", **changes):
    options = json.dumps(OPTIONS | {"run_id": run["id"]} | changes)
    files = [("files", (name, content))]
    return client.request("POST", "/v1/corrections", files=files, data={"options": options})


def ended(client, answer):
    """The job of an answer, when it has ended."""
    assert answer.status_code in {201, 202}, answer.text
    job, end = answer.json(), time.monotonic() + 60.0
    while job["state"] in {"queued", "running"} and time.monotonic() < end:
        time.sleep(0.1)
        job = client.get(job_at(job)).json()
    assert job["state"] == "succeeded", job
    return job


def rows_of(client, job, ending):
    answer = client.get(file_at(job, f"rows.{ending}"))
    assert answer.status_code == 200, answer.text
    if ending == "json":
        columns = answer.json()["columns"]
        headers = [f"{each['name']} [{each['unit']}]" if each["unit"] else each["name"] for each in columns]
        return pandas.DataFrame(dict(zip(headers, [each["values"] for each in columns], strict=True)))
    read = pandas.read_csv if ending == "csv" else pandas.read_parquet
    return read(io.BytesIO(answer.content))


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_file_comes_back_corrected_as_any_file(client, run, here, sent, ending):
    job = ended(client, post_file(client, run, packed(sent, ending), f"poses.{ending}"))
    assert job["result"]["counts"] == {"corrected": ROWS}
    assert job["request"]["files"][0]["name"] == f"poses.{ending}"
    assert (job["request"]["files"][0]["content"], job["result"]["table"]["content"]) == (None, None)
    expected = here.to_frame()
    for form, digits in (("csv", 1e-6), ("parquet", 1e-9), ("json", 1e-9)):
        rows = rows_of(client, job, form)
        assert list(rows["label"]) == list(sent["label"])
        assert set(rows["status"]) == {"corrected"}
        np.testing.assert_allclose(rows[NUMBERS], expected[NUMBERS], atol=digits, err_msg=form)


def test_more_rows_than_at_once_are_a_job(client, run, here, sent):
    names = {header: header.partition(" ")[0].lower() for header in sent.columns if header != "label"}
    body = OPTIONS | {
        "run_id": run["id"],
        "columns": {name: sent[header].tolist() for header, name in names.items()},
    }
    key = {"Idempotency-Key": "rows-once"}
    answer = client.request("POST", "/v1/corrections", json=body, headers=key)
    job = ended(client, answer)
    assert answer.headers["location"] == job_at(job)
    assert client.request("POST", "/v1/corrections", json=body, headers=key).json()["id"] == job["id"]
    assert job["progress"] == {
        "done": ROWS, "total": ROWS, "unit": "rows", "activity": "correcting"
    }  # fmt: skip
    rows = rows_of(client, job, "json")
    np.testing.assert_allclose(rows[NUMBERS], here.to_frame()[NUMBERS], atol=1e-9)


def test_few_rows_of_a_file_are_a_job_that_has_ended(client, run, sent):
    answer = post_file(client, run, packed(sent[:3], "csv"))
    assert (answer.status_code, answer.json()["progress"]) == (201, None)
    assert answer.json()["result"]["counts"] == {"corrected": 3}


class TestHostileFiles:
    """A file that is too large, damaged or incomplete is refused with what to do; the service goes on."""

    def refused(self, client, run, content, status=422, **changes):
        answer = post_file(client, run, content, **changes)
        assert answer.status_code == status, answer.text
        assert answer.json()["remedy"]
        return answer.json()["detail"]

    @pytest.mark.parametrize("ending", ["csv", "parquet"])
    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda table: table.drop(columns="z [mm]"), "the column z is missing"),
            (lambda table: table.drop(columns="J4 [deg]"), "the column j4 is missing"),
            (lambda table: table.rename(columns={"x [mm]": "x"}), "'x' has no unit"),
            (lambda table: table.rename(columns={"x [mm]": "x [N]"}), "'x [N]' has the unit N"),
            (lambda table: table.rename(columns={"x [mm]": "colour"}), "'colour' is not known"),
            (
                lambda table: table.assign(**{"x [mm]": np.inf}),
                "row 1 of column x contains a missing or infinite number",
            ),
            (lambda table: table[:0], "the table has no rows"),
            (
                lambda table: table.assign(label="P" * 300),
                "the label has 300 characters, but may have only 256",
            ),
            (
                lambda table: table.assign(**{f"c{i}": 0.0 for i in range(60)}),
                "the table has 73 columns, but may have only 64",
            ),
        ],
    )
    def test_what_is_wrong_is_named(self, client, run, sent, ending, change, words):
        assert words in self.refused(client, run, packed(change(sent[:4]), ending))

    def test_a_row_that_is_not_finite_is_named(self, client, run, sent):
        table = sent[:9].copy()
        table.loc[6, "rx [deg]"] = np.nan
        assert "row 7 of column rx contains a missing or infinite number" in self.refused(
            client, run, packed(table, "parquet")
        )
        assert "the cell '' of the column 'rx [deg]'" in self.refused(client, run, packed(table, "csv"))

    @pytest.mark.parametrize("ending", ["csv", "parquet"])
    def test_too_many_rows_are_counted_before_they_are_kept(self, client, run, ending):
        table = pandas.DataFrame({"x [mm]": np.zeros(100_001), "y [mm]": np.zeros(100_001)})
        content = packed(table, ending)
        assert len(content) < 2**20
        assert self.refused(client, run, content, 413) == "the table has more than 100,000 rows"

    def test_a_text_that_unpacks_to_gigabytes_is_refused(self, client, run):
        """One text of 1 MiB in 9,000 rows: a file of some kB, 9 GB as texts."""
        labels = pyarrow.DictionaryArray.from_arrays(np.zeros(9_000, np.int32), ["A" * 2**20])
        content = io.BytesIO()
        table = pyarrow.table({"x [mm]": np.zeros(9_000), "label": labels})
        parquet.write_table(table, content, compression="zstd")
        assert len(content.getvalue()) < 10_000
        assert "the label has 1,048,576 characters" in self.refused(client, run, content.getvalue())

    def test_texts_that_unpack_to_too_much_are_not_unpacked(self, client, run):
        labels = ["A" * 2**20 + str(i) for i in range(130)]
        content = io.BytesIO()
        table = pyarrow.table({"x [mm]": np.zeros(130), "label": labels})
        parquet.write_table(table, content, compression="zstd", use_dictionary=False)
        assert len(content.getvalue()) < 100_000
        words = self.refused(client, run, content.getvalue())
        assert words == "the columns take 130 MiB, but may take only 128"

    def test_lists_are_no_columns(self, client, run):
        content = io.BytesIO()
        parquet.write_table(pyarrow.table({"x [mm]": [[0.0] * 100_000] * 50}), content)
        words = self.refused(client, run, content.getvalue())
        assert words == "the column 'x [mm]' has cells that are not numbers"

    def test_a_damaged_file_is_refused(self, client, run, sent):
        whole = packed(sent[:50], "parquet")
        generator = np.random.default_rng(1)
        for _ in range(12):
            spoiled = bytearray(whole)
            for place in generator.integers(4, len(whole), 12).tolist():
                spoiled[place] = int(generator.integers(256))
            answer = post_file(client, run, bytes(spoiled), "poses.parquet")
            assert answer.status_code in {201, 202, 413, 422}, answer.text
        assert self.refused(client, run, b"PAR1") == "the file is no readable Parquet table"
        assert self.refused(client, run, whole[:-9]) == "the file is no readable Parquet table"
        assert post_file(client, run, whole).status_code == 201

    def test_a_form_without_a_table_is_refused(self, client, run):
        options = json.dumps(OPTIONS | {"run_id": run["id"]})
        for files in ([], [("files", (f"{i}.csv", b"x")) for i in range(2)]):
            form = {"files": files} if files else {"files": [("options", (None, options.encode()))]}
            data = {"data": {"options": options}} if files else {}
            answer = client.request("POST", "/v1/corrections", **form, **data)
            assert answer.status_code == 422, answer.text

    def test_a_wrong_tool_is_refused_as_at_once(self, client, run, sent):
        content = packed(sent[:20], "csv")
        assert "poses and joints differ" in self.refused(client, run, content, tool=[0.0] * 6)


def test_a_client_corrects_many_poses_by_a_job(service, here):
    told = []
    with js.Client(service.url) as client:
        done = client.correct(
            CAMPAIGN, POSES, np.degrees(JOINTS), tool=TOOL_IN_MM, forces=FORCE, on_progress=told.append
        )
        np.testing.assert_allclose(done.joints, here.joints, atol=1e-9)
        np.testing.assert_allclose(done.deflection, here.deflection, atol=1e-12)
        assert (done.status, done.counts, done.first) == (here.status, here.counts, here.first)
        job = next(client.corrections.list())
        assert client.corrections.get(job.id).result.counts == here.counts


def test_progress_is_told_and_a_correction_is_cancelled():
    told = []
    with pytest.raises(js.CampaignError, match="the correction was cancelled"):
        js.correct(
            CAMPAIGN,
            np.tile(POSES, (4, 1, 1)),
            np.degrees(np.tile(JOINTS, (4, 1))),
            tool=TOOL_IN_MM,
            forces=FORCE,
            on_progress=told.append,
            cancel=lambda: bool(told),
        )
    assert [(each.done, each.total, each.unit) for each in told] == [(10_000, 4 * ROWS, "rows")]
