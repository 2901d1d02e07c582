"""Jointstiff beside its peers, measured in one run on one machine.

    python -m benchmarks                  about two minutes
    python -m benchmarks small post       only these
    python -m benchmarks --quick          tiny sizes, a smoke test that judges nothing; with --all each night
    python -m benchmarks --json FILE      the same numbers, and every single time, for other programs

`performance/` compares times and memory, `studies/` proves numbers, `attacks/` breaks things. What several of
them share lies beside these folders. Candidates take turns (A B A B ...) and their medians are compared, so
what counts is a *ratio*: it carries over to other machines, seconds do not. Beside each figure that is asked
for stands what was measured, and whether it is met; the exit status does not depend on it. The data are made
by `jointstiff.simulator.campaign`, from seeds.
"""
