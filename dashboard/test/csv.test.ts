import { describe, expect, it } from "vitest";
import { csv, csvCell, fileName } from "../src/components/table";

describe("cells", () => {
  it("leave numbers as they are, negative ones too", () => {
    expect([csvCell(-1.5e-7), csvCell(0), csvCell(NaN), csvCell(null)]).toEqual(["-1.5e-7", "0", "", ""]);
  });
  it.each([
    "=1+1",
    "+1",
    "-2+3",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    " =1",
    "|cmd",
    "%0A",
    "\u00a0=1",
    "＝1",
    "＋1",
    "－1",
    "＠A1",
  ])("guard %j against being carried out", (text) => {
    expect(csvCell(text).replace(/^"/, "")).toMatch(/^'/);
  });
  it("quote what would break the table", () => {
    expect(csvCell('a "b", c')).toBe('"a ""b"", c"');
    expect(csvCell("a\r\nb")).toBe('"a\r\nb"');
    expect(csvCell("joint_1")).toBe("joint_1");
  });
});

it("a table has a byte order mark and CRLF", () => {
  expect(
    csv(
      ["joint", "k [N.m/rad]"],
      [
        ["joint_1", 1.5],
        ["=x", null],
      ],
    ),
  ).toBe('\ufeffjoint,k [N.m/rad]\r\njoint_1,1.5\r\n"\'=x",\r\n');
});

it.each([
  ["Joint stiffness", "joint-stiffness.csv"],
  ["../../etc/passwd", "etc-passwd.csv"],
  ["<img src=x>", "img-src-x.csv"],
  ["机器人", "jointstiff.csv"],
])("%s becomes a safe file name", (title, name) => expect(fileName(title, "csv")).toBe(name));
