"""Works of others that are distributed are named with their licences."""

import json
import re
from importlib.metadata import distribution, distributions
from pathlib import Path

ROOT = Path(__file__).parents[2]
NOTICES = (ROOT / "dashboard" / "public" / "notices.txt").read_text(encoding="utf-8")


def test_libraries_of_the_page_are_named_with_their_copyright():
    libraries = json.loads((ROOT / "dashboard" / "package.json").read_text())["dependencies"]
    for name in libraries:
        assert re.search(rf"Copyright .*{name}", NOTICES), name


def test_packages_that_are_not_permissive_are_named():
    names = re.findall(r"^([a-z0-9.-]+)(?:\[.*\])?==", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    assert len(names) > 40
    for name in set(names) & {
        one.name.lower().replace("_", "-") for one in distributions()
    }:  # of this system
        metadata = distribution(name).metadata
        stated = " ".join([metadata["License-Expression"] or "", *(metadata.get_all("Classifier") or [])])
        if re.search("GPL|GNU|MPL|Mozilla", stated):
            assert name in NOTICES, name
