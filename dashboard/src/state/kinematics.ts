/** Postures of an arm while its joints are moved. */
import { keepPreviousData } from "@tanstack/query-core";
import { useEffect, useRef, useState } from "preact/hooks";
import { queries } from "../api/queries";
import type { Posture, Problem, RobotSource } from "../api/types";
import { type QueryOptions, useQuery } from "./query";

export interface Drawn {
  kinematics: Posture[] | null;
  problem: Problem | null;
}

/**
 * Kinematics of a source in some configurations; while a new answer is on its way the last one stays. One request is
 * on its way at a time, so that a slider that moves does not flood the service.
 */
export function useKinematics(
  source: RobotSource | null,
  joints: number[][],
  keep = (options: QueryOptions<Posture[]>) => options,
): Drawn {
  const wanted = JSON.stringify([source, joints]);
  const [sent, send] = useState(wanted);
  const [from, angles] = JSON.parse(sent) as [RobotSource | null, number[][]];
  const { data, problem, isFetching } = useQuery({
    ...keep(queries.kinematics(from, angles)),
    enabled: from !== null,
    placeholderData: keepPreviousData,
  });
  useEffect(() => {
    if (!isFetching || from === null) send(wanted);
  }, [wanted, isFetching]);
  const last = useRef<Posture[] | null>(null);
  if (source === null) last.current = null;
  else if (data) last.current = data;
  return { kinematics: last.current, problem: source === null ? null : problem };
}
