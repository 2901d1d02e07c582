"""A joint or a configuration that is chosen in a table or a chart is shown on the arm."""

import re

import pytest
from playwright.sync_api import Page, expect
from support.browsing import Visit

ACCENT = """(canvas) => {
  const probe = document.createElement("i");
  probe.style.color = "var(--accent)";
  canvas.parentElement.append(probe);
  const [r, g, b] = getComputedStyle(probe).color.match(/\\d+/g).map(Number);
  probe.remove();
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const drawing = copy.getContext("2d");
  drawing.drawImage(canvas, 0, 0);
  const { data } = drawing.getImageData(0, 0, copy.width, copy.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const size = Math.hypot(data[i], data[i + 1], data[i + 2]) * Math.hypot(r, g, b);
    const alike = (data[i] * r + data[i + 1] * g + data[i + 2] * b) / size;
    if (alike > 0.985 && data[i + 1] - data[i] > 30) count += 1;
  }
  return count;
}"""
"""Number of pixels whose colour is a brightness of the accent."""
DRAWN = "() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))"


@pytest.fixture
def most_of(api, stored):
    """The configuration to which each joint contributes most, by name of the joint."""
    result = api.get(f"/v1/jobs/{stored.run}").json()["result"]
    labels = list(dict.fromkeys(row["observation"] for row in result["residuals"]))

    def label_of(joint: str) -> str:
        parts = next(each for each in result["contributions"] if each["joint"] == joint)["by_observation"]
        return labels[max(range(len(labels)), key=lambda i: abs(parts[i]))]

    return label_of


def band(page: Page) -> int:
    page.evaluate(DRAWN)
    return int(page.locator(".run-arm canvas[data-ready=true]").evaluate(ACCENT))


def arm_of(visited: Visit):
    arm = visited.page.get_by_role("region", name="The arm in one configuration")
    arm.locator("canvas[data-ready=true]").wait_for()
    return arm


def test_the_joint_of_a_chosen_row_is_shown_on_the_arm(visit, stored, most_of):
    visited = visit("desktop", view=f"#/runs/{stored.run}")
    page, arm = visited.page, arm_of(visited)
    before = band(page)
    page.get_by_role("button", name="joint_5", exact=True).click()
    expect(arm.locator(".scene-labels .chosen")).to_have_text("joint_5")
    expect(arm.get_by_role("status")).to_have_text(re.compile(r"^joint_5 contributes [\d.]+ mm$"))
    expect(arm.locator("p").first).to_contain_text(f"{most_of('joint_5')} deflects")
    assert band(page) > before + 100
    page.reload()  # it is in the address
    expect(arm.locator(".scene-labels .chosen")).to_have_text("joint_5")
    page.get_by_role("button", name="joint_5", exact=True).click()
    expect(arm.locator(".scene-labels .chosen")).to_have_count(0)


def test_a_phone_shows_the_joint_of_an_opened_row(visit, stored, most_of):
    visited = visit("phone", view=f"#/runs/{stored.run}")
    page, arm = visited.page, arm_of(visited)
    row = page.get_by_role("button", name="joint_3", exact=True)
    row.tap()
    expect(row).to_have_attribute("aria-expanded", "true")
    expect(arm.locator(".scene-labels .chosen")).to_have_text("joint_3")
    expect(arm.locator("p").first).to_contain_text(f"{most_of('joint_3')} deflects")
    row.tap()
    expect(row).to_have_attribute("aria-expanded", "false")
    expect(arm.locator(".scene-labels .chosen")).to_have_count(0)


def test_a_chosen_bar_turns_the_arm_and_a_chosen_joint_stands_out(visit, stored):
    visited = visit("desktop", view=f"#/runs/{stored.run}/deflection")
    page, arm = visited.page, arm_of(visited)
    chart = page.locator("figure", has_text="Contribution of each joint")
    legend = chart.get_by_role("button", name="joint_2", exact=True)
    legend.click()
    expect(legend).to_have_attribute("aria-pressed", "true")
    expect(arm.locator(".scene-labels .chosen")).to_have_text("joint_2")
    assert chart.locator(".bars:not(.behind)").count() == 1
    chart.locator(".hit").nth(6).click()
    expect(arm.locator("p").first).to_contain_text("c07 deflects")
    expect(arm.locator(".scene-labels .chosen")).to_have_text("joint_2")
    expect(chart.locator(".hit.at")).to_have_attribute("data-tip", re.compile("^c07"))


def test_a_phone_names_every_joint_at_the_arm(visit, stored):
    visited = visit("phone", view=f"#/runs/{stored.run}")
    arm = arm_of(visited)
    visited.page.evaluate(DRAWN)
    names = arm.locator(".scene-labels span:not(.x, .y, .z)").filter(visible=True)
    expect(names).to_have_count(6)
    room = arm.locator(".scene-labels").bounding_box()
    for name in names.all():
        box = name.bounding_box()
        assert box["y"] >= room["y"]
        assert box["y"] + box["height"] <= room["y"] + room["height"]
