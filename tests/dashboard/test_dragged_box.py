"""The box of a map and of a workpiece, dragged in 3D: its numbers follow."""

import re

import pytest
from playwright.sync_api import expect
from support.processes import until

GRIPS = """(canvas) => {
  const box = canvas.getBoundingClientRect();
  const found = [];
  for (let y = box.top + 4; y < box.bottom; y += 8)
    for (let x = box.left + 4; x < box.right; x += 8) {
      canvas.dispatchEvent(new PointerEvent("pointermove", { clientX: x, clientY: y, pointerType: "mouse" }));
      if (canvas.style.cursor !== "pointer") continue;
      const near = found.find((one) => Math.hypot(one.x / one.n - x, one.y / one.n - y) < 30);
      if (near) { near.x += x; near.y += y; near.n += 1; } else found.push({ x, y, n: 1 });
    }
  return found.map(({ x, y, n }) => [x / n, y / n, n]);
}"""
"""Middles of the places [px] where a hand would drag something, and how many of the places tried each has."""
DRAWN = "() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))"
BOX = "-1000, -1000, 0\n1000, 1000, 1800"
FINGER = 20  # places of 8 px squared that a finger of 44 px finds


def corners(field):
    """Return the six numbers of a field [mm]."""
    return [float(number) for number in re.findall(r"-?[\d.]+", field.input_value())]


def grips(page):
    """Return the places of a picture that can be dragged [px]."""
    canvas = page.locator("canvas[data-ready=true]")
    canvas.wait_for()
    canvas.scroll_into_view_if_needed()
    until(lambda: len(canvas.evaluate(GRIPS)) > 1)
    return canvas.evaluate(GRIPS)


def by_mouse(page, x, y):
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 20, y - 12, steps=3)
    page.mouse.move(x + 45, y - 30, steps=3)
    page.mouse.up()


def by_finger(page, x, y):
    session = page.context.new_cdp_session(page)
    for kind, places in {
        "touchStart": [(x, y)],
        "touchMove": [(x + 20, y - 12), (x + 45, y - 30)],
        "touchEnd": [None],
    }.items():
        for place in places:
            touched = [] if place is None else [{"x": place[0], "y": place[1]}]
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touched})
    session.detach()


@pytest.mark.parametrize(("size", "drag"), [("desktop", by_mouse), ("phone", by_finger)])
def test_numbers_follow_each_grip_of_the_box_of_a_map(visit, stored, api, size, drag):
    page = visit(size, view=f"#/runs/{stored.run}/map").page
    field = page.get_by_label("Box: least and greatest corner")
    moves = []
    field.fill(BOX)
    found = grips(page)
    assert 4 <= len(found) <= 7, found  # some may be behind others
    assert max(places for *_, places in found) >= FINGER
    for x, y, _ in found:
        field.fill(BOX)
        page.evaluate(DRAWN)  # a hand takes what it sees: the grips of the box that is typed
        before = corners(field)
        drag(page, x, y)
        changes = [b - a for a, b in zip(before, corners(field), strict=True)]
        if any(changes):
            moves.append([round(change) for change in changes])
    faces = [move for move in moves if sum(map(bool, move)) == 1]
    middles = [move for move in moves if move[:3] == move[3:] and move[2] == 0]
    assert len(faces) + len(middles) == len(moves) >= 3, moves
    assert len(middles) == 1, (found, moves)
    assert all(change % 10 == 0 for move in moves for change in move)
    wanted = corners(field)
    page.get_by_label("Process force on the robot").fill("0, 0, -500")
    page.get_by_label("Places along x, y, z").fill("2, 2, 1")
    page.get_by_role("button", name="Make the map").click()
    expect(page).to_have_url(re.compile("#/maps/"))
    job = api.get(f"/v1/jobs/{page.url.rsplit('/', 1)[1]}").json()
    assert [1e3 * part for corner in job["request"]["area"] for part in corner] == pytest.approx(wanted)


def test_a_box_that_is_typed_is_drawn_and_the_rest_of_the_picture_turns_the_robot(visit, stored):
    visited = visit("desktop", view=f"#/runs/{stored.run}/map")
    page = visited.page
    field = page.get_by_label("Box: least and greatest corner")
    grips(page)
    picture = page.locator("canvas[data-ready=true]")
    drawn = picture.screenshot()
    field.fill(BOX)
    until(lambda: picture.screenshot() != drawn)
    drawn = picture.screenshot()
    box = picture.bounding_box()
    by_mouse(page, box["x"] + 30, box["y"] + 60)
    until(lambda: picture.screenshot() != drawn)
    assert corners(field) == [-1000.0, -1000.0, 0.0, 1000.0, 1000.0, 1800.0]
