"""Optimal design of campaigns: which postures and loads to measure, with a certificate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.solver.design.advice import advise
    from jointstiff.solver.design.advised_reading import Advice
    from jointstiff.solver.design.campaign_plan import CampaignPlan, plan_campaign
    from jointstiff.solver.design.candidates import PackedCandidates
    from jointstiff.solver.design.criteria import AOptimality, DOptimality, EOptimality, GOptimality
    from jointstiff.solver.design.distinct import Distinct
    from jointstiff.solver.design.exact import ExactDesign, exact_design
    from jointstiff.solver.design.experiment import Equipment, Loads, targets_in_flange
    from jointstiff.solver.design.feasibility import Cell
    from jointstiff.solver.design.optimum import Design, optimise
    from jointstiff.solver.design.plan_request import PlanRequest
    from jointstiff.solver.design.problem import DesignProblem
else:
    __getattr__ = names_of(
        __name__,
        advice="advise",
        advised_reading="Advice",
        campaign_plan="CampaignPlan plan_campaign",
        candidates="PackedCandidates",
        criteria="AOptimality DOptimality EOptimality GOptimality",
        distinct="Distinct",
        exact="ExactDesign exact_design",
        experiment="Equipment Loads targets_in_flange",
        feasibility="Cell",
        optimum="Design optimise",
        plan_request="PlanRequest",
        problem="DesignProblem",
    )

__all__ = [
    "AOptimality",
    "Advice",
    "CampaignPlan",
    "Cell",
    "DOptimality",
    "Design",
    "DesignProblem",
    "Distinct",
    "EOptimality",
    "Equipment",
    "ExactDesign",
    "GOptimality",
    "Loads",
    "PackedCandidates",
    "PlanRequest",
    "advise",
    "exact_design",
    "optimise",
    "plan_campaign",
    "targets_in_flange",
]
