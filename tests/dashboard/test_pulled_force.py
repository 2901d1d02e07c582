"""The force of a prediction, pulled by mouse, finger or keys: the number is that of `predict`."""

import re
from functools import partial

import pytest
from playwright.sync_api import Page, expect
from support.api import made, post
from support.browsing import Visit, campaign
from support.processes import until

HEAD = """(canvas) => {
  const box = canvas.getBoundingClientRect();
  let [x, y, n] = [0, 0, 0];
  for (let v = box.top + 4; v < box.bottom; v += 6)
    for (let u = box.left + 4; u < box.right; u += 6) {
      const options = { clientX: u, clientY: v, pointerType: "mouse" };
      canvas.dispatchEvent(new PointerEvent("pointermove", options));
      if (canvas.style.cursor === "pointer") [x, y, n] = [x + u, y + v, n + 1];
    }
  return n > 0 ? [x / n, y / n] : null;
}"""
"""Middle of the places [px] where a hand would pull the force."""
DRAWN = "() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))"


@pytest.fixture(scope="module")
def run(api, stored):
    """A run whose loads twist every joint: a force along any axis has an answer."""
    document = campaign(load="pull", configurations=19, seed=8)["measurement_set"]
    pulled = post(api, "/v1/measurement-sets", {**document, "robot_id": stored.robot})["id"]
    return made(api, partial(api.post, "/v1/runs?wait=60", json={"measurement_set_id": pulled}))


def by_mouse(page: Page, x: float, y: float) -> None:
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 12, y - 10, steps=4)
    page.mouse.move(x + 31, y - 24, steps=6)
    page.mouse.up()


def by_finger(page: Page, x: float, y: float) -> None:
    session = page.context.new_cdp_session(page)
    for kind, place in (
        ("touchStart", (x, y)),
        ("touchMove", (x + 12, y - 10)),
        ("touchMove", (x + 31, y - 24)),
        ("touchEnd", None),
    ):
        points = [] if place is None else [{"x": place[0], "y": place[1]}]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    session.detach()


def by_keys(page: Page, x: float, y: float) -> None:
    page.locator("canvas[data-ready=true]").focus()
    for key in ("ArrowUp", "ArrowUp", "ArrowRight", "ArrowLeft", "ArrowRight"):
        page.keyboard.press(f"Shift+{key}")


def numbers(text: str) -> list[float]:
    """Return the numbers of a field or a view."""
    return [float(one) for one in re.findall(r"-?\d+(?:\.\d+)?", text.replace("\u2212", "-"))]


@pytest.mark.parametrize(
    ("size", "pull"),
    [("desktop", by_mouse), ("phone", by_finger), ("desktop", by_keys)],
    ids=["mouse", "finger", "keys"],
)
def test_the_number_of_a_pulled_force_is_that_of_predict(visit, run, api, size, pull):
    visited: Visit = visit(size, view=f"#/runs/{run}/predict")
    page = visited.page
    field = page.get_by_label("Force on the robot")
    field.fill("0, 0, -500")
    page.get_by_role("button", name="Predict").click()
    canvas = page.locator("canvas[data-ready=true]")
    canvas.wait_for()
    canvas.scroll_into_view_if_needed()
    until(lambda: canvas.evaluate(HEAD) is not None)
    pull(page, *canvas.evaluate(HEAD))
    expect(field).not_to_have_value(re.compile(r"^0, 0, -500$"))
    page.evaluate(DRAWN)
    answer = page.locator("section.card[aria-live]")
    expect(answer).to_have_attribute("aria-busy", "false")
    force = numbers(field.input_value())
    assert all(part % 10 == 0 for part in force)
    joints, place = (
        numbers(page.get_by_label(label).input_value())
        for label in ("Joints as the controller shows them", "Load point and tool")
    )
    case = {"joints": joints, "force": force, "load_point": place}
    units = {"length": "mm", "angle": "deg", "force": "N"}
    asked = api.post("/v1/deflections", json={"run_id": run, "units": units, "cases": [case]}).json()
    moved = asked["cases"][0]["displacement"]
    wanted = [1e6 * sum(part * part for part in moved) ** 0.5, *(1e6 * part for part in moved)]
    shown = answer.locator("dd .estimate").all_inner_texts()
    for text, value in zip(shown, wanted, strict=True):
        figure = re.match(r"[-\u2212]?[\d.]+", text)[0].replace("\u2212", "-")
        decimals = len(figure.partition(".")[2])
        assert float(figure) == pytest.approx(round(value, decimals), abs=1e-9), (text, value)
    answers = [url for url in visited.requests if url.endswith("/v1/deflections")]
    assert len(answers) <= 1 + 12
