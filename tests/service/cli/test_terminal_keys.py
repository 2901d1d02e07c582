"""Keys and databases at the terminal: what is shown, and what is not."""

import re

import pytest
from support.command_lines import assert_said, refused, typed

URL = "sqlite:///db.sqlite"
ADVICE = "remedy: give sqlite:///path/to/file.db or postgresql://user:password@host/database"


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def created(options="--role operator --expires 2999-01-01"):
    """Create a key; return it and its id."""
    said = typed(f"keys create 'tablet hall 3' {options} --database {URL}")
    (key,) = set(re.findall(r"js[a-z]_[A-Za-z0-9_]+", said))
    return key, key.split("_")[1]


def test_a_key_is_shown_once_and_listed_by_its_id_alone():
    key, identifier = created()
    said = typed(f"keys list --database {URL}", width=160)
    assert_said(
        said,
        "Keys, times in UTC",
        "┃ id ┃ name ┃ role ┃ state ┃ made ┃ last used ┃",
        f"│ {identifier} │ tablet hall 3 │ operator │ valid until 2999-01-01 00:00 │",
        "│ — │",
    )
    assert key not in said


def test_a_revoked_key_is_listed_as_such():
    _, identifier = created()
    assert typed(f"keys revoke {identifier} --database {URL}") == (
        f"revoked {identifier}, tablet hall 3; running services refuse it within a second"
    )
    assert_said(typed(f"keys list --database {URL}", width=160), "│ operator │ revoked 20")
    said = refused(f"keys link {identifier} --database {URL}")
    assert said == f"the service has no key '{identifier}' remedy: see `jointstiff keys list`"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            "--role owner",
            "Error: Invalid value for '--role': Value error, 'owner' is not one of 'viewer', 'operator', "
            "'admin'.",
        ),
        (
            "--role viewer --expires 2001-01-01",
            "Error: Invalid value for --expires: must be in the future",
        ),
    ],
)
def test_a_key_of_another_role_or_of_the_past_is_refused(options, said):
    assert refused(f"keys create x {options} --database {URL}") == said


def test_a_database_is_not_made_by_asking_for_its_keys(tmp_path):
    assert refused(f"keys list --database {URL}") == f"there is no database db.sqlite {ADVICE}"
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_key_is_not_revoked():
    created()
    said = refused(f"keys revoke 0000000000 --database {URL}")
    assert said == "there is no key '0000000000' remedy: see `jointstiff keys list` for the ids"


@pytest.mark.parametrize(
    ("database", "said"),
    [
        ("mysql://x/y", f"mysql is not a supported database {ADVICE}"),
        ("nonsense", f"the database URL is invalid {ADVICE}"),
        (
            "sqlite:////proc/nothing/x.db",
            "the sqlite database failed (unable to open database file) "
            "remedy: check that the file is writable and its disk is not full",
        ),
    ],
)
def test_a_service_does_not_start_without_its_database(database, said):
    assert refused(f"serve --database {database} --port 0") == said


def test_a_post_to_nobody_says_how_to_start_a_service(tmp_path):
    typed("simulate pull.json")
    assert refused("post pull.json --server http://127.0.0.1:9") == (
        "no answer from http://127.0.0.1:9: [Errno 111] Connection refused remedy: start it with "
        "`jointstiff serve`, or give the address of a running service with --server"
    )
