"""Translation between messages (schemas) and the numerical core (solver)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.service.conversion.assessments import combined, to_assessment, to_joints
    from jointstiff.service.conversion.budgets import (
        to_budget,
        to_covariances,
        to_deflection_budgets,
        to_joint_budgets,
    )
    from jointstiff.service.conversion.csv_table import comparison_csv, guarded
    from jointstiff.service.conversion.deflections import (
        moment_factor,
        to_directions,
        to_elastic_model,
        to_elastic_predictor,
        to_identified_model,
        to_joint_model,
        to_load_cases,
        to_own_weight,
    )
    from jointstiff.service.conversion.frames import in_base, stated_transform, to_resolved
    from jointstiff.service.conversion.geometry import to_geometry_result
    from jointstiff.service.conversion.links import (
        to_elastic_columns,
        to_links_result,
        to_losses,
        to_plan,
        to_selection,
    )
    from jointstiff.service.conversion.load_case_table import prediction_csv, read_load_cases
    from jointstiff.service.conversion.maps import (
        map_columns,
        map_csv,
        map_npz,
        to_map_result,
        to_map_task,
        to_places,
    )
    from jointstiff.service.conversion.measurements import to_findings, to_measurements, to_warnings
    from jointstiff.service.conversion.pairs import AssessedSide, to_pair_result
    from jointstiff.service.conversion.parsing import MAX_SET_BYTES, NOT_JSON, MalformedError, parse
    from jointstiff.service.conversion.plans import to_design_request, to_plan_result
    from jointstiff.service.conversion.predictions import to_case_results
    from jointstiff.service.conversion.readings import ReadingArrays, content_hash
    from jointstiff.service.conversion.requests import to_settings
    from jointstiff.service.conversion.results import to_encoder_residuals, to_resampling_result, to_result
    from jointstiff.service.conversion.robots import (
        build_robot,
        describe_joints,
        describe_wrist,
        dh_kinematics,
        to_kinematics,
    )
    from jointstiff.service.conversion.sweeps import (
        to_base_targets,
        to_conventions,
        to_poses,
        to_sweeps,
    )
    from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH, MOMENT
else:
    __getattr__ = names_of(
        __name__,
        assessments="combined to_assessment to_joints",
        budgets="to_budget to_covariances to_deflection_budgets to_joint_budgets",
        csv_table="comparison_csv guarded",
        deflections="moment_factor to_directions to_elastic_model to_elastic_predictor to_identified_model "
        "to_joint_model to_load_cases to_own_weight",
        frames="in_base stated_transform to_resolved",
        geometry="to_geometry_result",
        links="to_elastic_columns to_links_result to_losses to_plan to_selection",
        load_case_table="prediction_csv read_load_cases",
        maps="map_columns map_csv map_npz to_map_result to_map_task to_places",
        measurements="to_findings to_measurements to_warnings",
        pairs="AssessedSide to_pair_result",
        parsing="MAX_SET_BYTES MalformedError NOT_JSON parse",
        predictions="to_case_results",
        plans="to_design_request to_plan_result",
        readings="ReadingArrays content_hash",
        requests="to_settings",
        results="to_encoder_residuals to_resampling_result to_result",
        robots="build_robot describe_joints describe_wrist dh_kinematics to_kinematics",
        sweeps="to_base_targets to_conventions to_poses to_sweeps",
        units="ANGLE FORCE LENGTH MOMENT",
    )

__all__ = [
    "ANGLE",
    "FORCE",
    "LENGTH",
    "MAX_SET_BYTES",
    "MOMENT",
    "NOT_JSON",
    "AssessedSide",
    "MalformedError",
    "ReadingArrays",
    "build_robot",
    "combined",
    "comparison_csv",
    "content_hash",
    "describe_joints",
    "describe_wrist",
    "dh_kinematics",
    "guarded",
    "in_base",
    "map_columns",
    "map_csv",
    "map_npz",
    "moment_factor",
    "parse",
    "prediction_csv",
    "read_load_cases",
    "stated_transform",
    "to_assessment",
    "to_base_targets",
    "to_budget",
    "to_case_results",
    "to_conventions",
    "to_covariances",
    "to_deflection_budgets",
    "to_design_request",
    "to_directions",
    "to_elastic_columns",
    "to_elastic_model",
    "to_elastic_predictor",
    "to_encoder_residuals",
    "to_findings",
    "to_geometry_result",
    "to_identified_model",
    "to_joint_budgets",
    "to_joint_model",
    "to_joints",
    "to_kinematics",
    "to_links_result",
    "to_load_cases",
    "to_losses",
    "to_map_result",
    "to_map_task",
    "to_measurements",
    "to_own_weight",
    "to_pair_result",
    "to_places",
    "to_plan",
    "to_plan_result",
    "to_poses",
    "to_resampling_result",
    "to_resolved",
    "to_result",
    "to_selection",
    "to_settings",
    "to_sweeps",
    "to_warnings",
]
