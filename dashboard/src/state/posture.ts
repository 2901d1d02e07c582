/** The posture of a robot for some angles, from the service: the newest question is answered, those between are left out. */
import { useEffect, useRef, useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { Kinematics, Problem, RobotSource } from "../api/types";

export interface Drawn {
  kinematics: Kinematics | null;
  problem: Problem | null;
}

/** Kinematics of a source in some configurations; while a new answer is on its way the last one stays. */
export function useKinematics(source: RobotSource | null, joints: number[][]): Drawn {
  const [drawn, set] = useState<Drawn>({ kinematics: null, problem: null });
  const wanted = useRef<string | null>(null);
  const asking = useRef(false);
  const question = source && JSON.stringify([source, joints]);
  useEffect(() => {
    wanted.current = question;
    if (question === null) set({ kinematics: null, problem: null });
    else void ask();
    return () => {
      wanted.current = null;
    };
  }, [question]);
  useEffect(() => {
    const back = () => void ask(); // what was asked while the network was away
    addEventListener("online", back);
    return () => removeEventListener("online", back);
  }, []);

  async function ask(): Promise<void> {
    if (asking.current) return;
    asking.current = true;
    for (let asked: string | null = null; wanted.current !== null && wanted.current !== asked; ) {
      asked = wanted.current;
      const [from, angles] = JSON.parse(asked) as [RobotSource, number[][]];
      const answer: Drawn = await api.kinematics(from, angles).then(
        (kinematics) => ({ kinematics, problem: null }),
        (error: unknown) => ({ kinematics: null, problem: problemOf(error) }),
      );
      if (wanted.current !== null) set((last) => ({ ...answer, kinematics: answer.kinematics ?? last.kinematics }));
    }
    asking.current = false;
  }
  return drawn;
}
