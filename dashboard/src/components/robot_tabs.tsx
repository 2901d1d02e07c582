/** Robots, their sets and their geometries: three lists of one section. */
import { text } from "../i18n";
import { Tabs } from "./basics";

export function RobotTabs({ current }: { current: "robots" | "sets" | "geometries" | "fleet" }) {
  return (
    <Tabs
      label={text.robots.tabs}
      current={current}
      tabs={[
        { id: "robots", label: text.robots.title, href: "#/robots" },
        { id: "sets", label: text.robots.sets, href: "#/sets" },
        { id: "geometries", label: text.geometry.title, href: "#/geometries" },
        { id: "fleet", label: text.fleet.title, href: "#/fleet" },
      ]}
    />
  );
}
