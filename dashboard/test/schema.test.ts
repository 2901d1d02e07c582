import { describe, expect, it } from "vitest";
import { understood } from "../src/components/schema_form";
import { codecOf, isAmbiguous, plain, type Schema } from "../src/lib/schema";
import { jsonOf, unreadIn } from "../src/lib/json";
import { noiseOf } from "../src/lib/campaign";
import { requestOf } from "../src/features/readings/flow";

const NUMBER: Schema = { type: "number" };
const VECTOR: Schema = { type: "array", prefixItems: [NUMBER, NUMBER, NUMBER] };
const ALL = { Row: { properties: { a: NUMBER } }, Point: VECTOR };
const codec = (schema: Schema, factor = 1) => {
  const found = codecOf(plain(schema, ALL), ALL, factor);
  if (!found) throw new Error("not typed in one box");
  return found;
};

describe("what is typed for a value of the API", () => {
  it("is read in the page's unit, with a decimal point or comma, without digits of the factor", () => {
    expect(codec(NUMBER, 1e-3).read("1 700")).toBeUndefined();
    expect(codec(NUMBER, 1e-3).read("1,7")).toBe(0.0017);
    expect(codec(NUMBER, 1e6).read("0.86")).toBe(860000);
    expect(codec(NUMBER).read(" ")).toBeNull();
    expect(codec(NUMBER, 1e-6).show(2e-5)).toBe("20");
  });
  it("is ambiguous where a mark may part thousands or a fraction, and only there", () => {
    for (const typed of ["1,500", "1.500", "-1,500", "0 0 -1.500", "12.345; 3", "123,456"])
      expect(isAmbiguous(typed), typed).toBe(true);
    for (const typed of ["1.5", "0.500", "1500", "1,5", "1234.567", "1.5000", "12", "", "0 0 -500"])
      expect(isAmbiguous(typed), typed).toBe(false);
  });
  it("is ambiguous in any place of a list, by any of the usual marks, and where a mark may part the list", () => {
    for (const number of ["1.500", "-1.500", "\u22121.500", "12.345", "123.456"])
      for (const mark of [", ", " ", "; ", ",", ";"])
        for (const [before, behind] of [
          [0, 2],
          [1, 1],
          [2, 0],
        ]) {
          const typed = [...Array(before).fill("0"), number, ...Array(behind).fill("0.5")].join(mark);
          expect(isAmbiguous(typed), typed).toBe(true);
          expect(isAmbiguous(`[${typed}]`), typed).toBe(true);
        }
    for (const typed of ["-1,500, 0, 0", "0, -1,500, 0", "1,500,0", "0,1,500", "1,500; 0; 0", "1.500,0", "5,1.500,2"])
      expect(isAmbiguous(typed), typed).toBe(true);
    for (const typed of ["100, -20, 5", "0.500,0.250,1", "1500.125, 0, 0", "0,-20,5", "1.5, 2.25, 3.1415"])
      expect(isAmbiguous(typed), typed).toBe(false);
  });
  it("says what is understood of it", () => {
    const vector = codec(VECTOR);
    expect(understood(vector, "-1.500, 0, 0", "N")).toBe("Understood as -1.5, 0, 0 N");
    expect(understood(vector, "1,500,0", "N")).toBe("Understood as 1, 500, 0 N");
    expect(understood(vector, "1,500", "N")).toBeUndefined(); // two numbers: the field says that it is not understood
  });
  it("is three numbers of a vector, in any of the usual ways", () => {
    for (const typed of ["100, -20, 5", "100 -20 5", "100; -20; 5", "100,-20,5", "[100, -20, 5]"])
      expect(codec({ $ref: "#/components/schemas/Point" }, 1e-3).read(typed)).toEqual([0.1, -0.02, 0.005]);
    expect(codec(VECTOR).read("1 2")).toBeUndefined();
    expect(codec(VECTOR, 1e-3).show([0.1, -0.02, 0.005])).toBe("100, -20, 5");
  });
  it("is a line each of several, with its name where they have names", () => {
    const targets = codec({ type: "object", additionalProperties: VECTOR }, 1e-3);
    expect(targets.read("P1 1 2 3\n\nP2 4, 5, 6")).toEqual({ P1: [0.001, 0.002, 0.003], P2: [0.004, 0.005, 0.006] });
    expect(targets.read("P1 1 2")).toBeUndefined();
    expect(targets.show({ P1: [0.001, 0.002, 0.003] })).toBe("P1 1, 2, 3");
    expect(codec({ type: "array", items: VECTOR }).read("1 2 3\n4 5 6")).toEqual([
      [1, 2, 3],
      [4, 5, 6],
    ]);
    const order: Schema = { type: "array", items: { type: "array", items: { type: "string" } } };
    expect(codec(order).read("joint_2, joint_4")).toEqual([["joint_2", "joint_4"]]);
    expect(codec(order).read("axis 2, axis 4\naxis 4; axis 6")).toEqual([
      ["axis 2", "axis 4"],
      ["axis 4", "axis 6"],
    ]);
    expect(codec(order).read("A2 A4")).toEqual([["A2", "A4"]]);
  });
  it("has no box where a value has parts of its own", () => {
    expect(codecOf({ type: "array", items: { $ref: "x/Row" } }, ALL)).toBeNull();
    expect(plain({ anyOf: [{ $ref: "x/Row" }, { type: "null" }] }, ALL).nullable).toBe(true);
  });
  it("is found where it was not understood, and posted as it was typed", () => {
    const document = { goal: [{ a: 1 }, { unread: "1 x" }] };
    expect(unreadIn(document)).toBe("1 x");
    expect(jsonOf(document)).toBe('{"goal":[{"a":1},"1 x"]}');
    expect(unreadIn({ a: "x" })).toBeNull();
  });
  it("is still not understood after it was kept by the browser", () => {
    const document = { goal: [{ a: 1 }, { unread: "1 x" }], name: "1 x" };
    expect(unreadIn(JSON.parse(JSON.stringify(document)))).toBe("1 x");
    expect(unreadIn(structuredClone(document))).toBe("1 x");
  });
});

describe("request of a run", () => {
  it("does not send what was not stated, or is not used", () => {
    expect(requestOf("s", {})).toEqual({ measurement_set_id: "s" });
    expect(requestOf("s", { loss: "huber", huber_threshold: 2, method: null, link_penalty: 0.1 })).toEqual({
      measurement_set_id: "s",
      loss: "huber",
      huber_threshold: 2,
    });
    expect(requestOf("s", { huber_threshold: 2, characteristic_length: 1.5 })).toEqual({ measurement_set_id: "s" });
    expect(requestOf("s", { cross_validation: { folds: null }, stiffness_bounds: { a: [1, null] } })).toEqual({
      measurement_set_id: "s",
      cross_validation: {},
      stiffness_bounds: { a: [1, null] },
    });
  });
});

describe("noise of a set", () => {
  const units = { length: "mm", angle: "deg", force: "N" } as const;
  it("is stated in SI and posted in the units of the set", () => {
    expect(noiseOf({ force: { scale: null } }, null, units as never)).toBeNull();
    expect(noiseOf({ load_point: 0 }, null, units as never)).toEqual({ load_point: 0 }); // known exactly
    expect(noiseOf({ sigma: 2e-5, force: { scale: 0.01 } }, null, units as never)).toEqual({
      sigma: 0.02,
      force: { scale: 0.01 },
    });
    const instrument = { station: [4, 0, 1.5], range: { constant: 1e-5 }, transverse: { per_distance: 5e-6 } };
    expect(noiseOf({ instrument }, { sigma: 0.02 } as never, units as never)).toEqual({
      instrument: {
        station: [4000, 0, 1500],
        range: { constant: 0.01, per_distance: 0 },
        transverse: { constant: 0, per_distance: 5e-6 },
      },
    });
  });
  it("is left to the residuals, and keeps what else was stated", () => {
    expect(
      noiseOf({ residuals: true }, { sigma: 0.02, load_point: 1, refuted: true } as never, units as never),
    ).toEqual({
      load_point: 1,
      refuted: true,
    });
  });
});
