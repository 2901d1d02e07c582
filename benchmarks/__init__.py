"""Jointstiff beside its peers, measured in one run on one machine.

    python -m benchmarks                  everything, about two minutes
    python -m benchmarks small post       only these
    python -m benchmarks --quick          tiny sizes, a smoke test that judges nothing
    python -m benchmarks --json FILE      the same numbers, and every single time, for other programs

Candidates take turns (A B A B ...) and their medians are compared, so what counts is a *ratio*: it
carries over to other machines, seconds do not. Beside each figure that is asked for stands what was
measured, and whether it is met; the exit status does not depend on it. The data are made by
`jointstiff.simulator.campaign`, from seeds.

Benchmarks: `small` (19 configurations), `large` (100,000), `memory` (up to 1,000,000), `resampling` (1,000
times 10 of 19), `post` (a run over HTTP), `start` (commands beside bare imports,
idle memory), `exactness` (against exact rational arithmetic). By name only:
`access` (the cost of a key; half a minute),
`attacks` (hostile bodies, connections and requests; half an hour), `hostile` (its 100,000 requests
alone; a quarter of an hour, or `--part 1/8`), `faults` (disks, locks, clocks, servers and workers that
fail; ten minutes, as root), `workers` (two beside one, answers meanwhile, cancelling; four minutes) and
`durability` (kill -9 of workers and services; twenty minutes), which start PostgreSQL servers of their own;
`maps` (beside a loop of Pinocchio calls); `plan` (optimal designs beside cvxpy), `plan_figaroh` and
`plan_sizes` (1e5 and 1e6 candidates).

Studies, which prove numbers instead of comparing times, by name only as well: `coverage` (how often intervals
hold the truth; some minutes), `efficiency` (beside the Cramér-Rao bound), `robustness` (gross errors),
`fanuc` (ten of thirty real configurations), `replication` (the paper's study on a simulated arm; see
docs/replication.md), `links` (elastic links: held-out compensation, certificates, time; see
docs/elastic-links.md; ten minutes), `plan_lists`, `plan_promise` and `plan_nuisance` (see docs/plan.md; some
minutes each), `assessment` (verdicts on planted mistakes and clean sets; ten minutes)
`programs` (compensated programs beside exact springs and a bare loop of EAIK; hostile files; see
docs/compensate.md), `exports` (a run in MuJoCo beside C·τ; see docs/exports.md),
`reports` (size, time and bytes; see docs/report.md),
`importing` (files of readings in ten habits, and 20,000 mutated ones; see docs/import.md; a minute)
and `invariance` (why no characteristic length; see
docs/no-characteristic-length.md).
"""
