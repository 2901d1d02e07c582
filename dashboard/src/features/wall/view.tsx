/** The wall of all robots, the worst first. */
import { Title } from "../../components/basics";
import { RobotTabs } from "../robots/view";
import { Wall } from "./table";
import { wallWords as words } from "./words";

export function WallView() {
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <RobotTabs current="wall" />
      <Wall />
    </>
  );
}
