"""Meaning of each code of a finding, in words; the reference *Findings* is made of it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from jointstiff.schemas.finding import FindingCode
from jointstiff.schemas.joints import GOAL

MEANINGS: Final[Mapping[str, Mapping[FindingCode, str]]] = MappingProxyType(
    {
        "Readings": {
            "length_unit_suspect": "The unit of length is probably wrong: with another unit, each target has "
            "the same place on the flange in every observation. Also: all load points and targets are over "
            "10 m, or below 2 mm, from the flange. *Do not use.*",
            "angle_unit_suspect": "The unit of angles is probably wrong: with another unit, each target has "
            "the same place on the flange in every observation. Without positions: angles are many turns, "
            "or all are within 6.3°. *Do not use.*",
            "force_unit_suspect": "The median force is below 5 N or above 50 kN. *Do not use.*",
            "lengths_differ": "With one factor on all lengths, over 0.6 % from 1, each target "
            "keeps its place on the flange: another arm was measured, or the tracker has a wrong scale: *use "
            "with care*. With one other length of the robot's model, each target keeps its place: *do not "
            "use*.",
            "frame_mistaken": "In another frame than R0, or with exchanged axes x, y, z, each target has the "
            "same place on the flange in every observation; or forces in other axes explain the deflections. "
            "*Do not use.*",
            "frame_left_handed": "Each target has the same place on the flange in every observation only in "
            "a left-handed frame. *Do not use.*",
            "joint_sign_suspect": "The readings fit far better with the opposite signs of joints, or the "
            "angles have no signs. *Do not use.*",
            "joints_counted_otherwise": "The readings fit far better if the third joint is counted from the "
            "horizontal, or if the zero of a joint is a quarter turn away: *do not use*. If a zero is less "
            "far away: *use with care*.",
            "joints_swapped": "The readings fit far better if two columns of joint angles are exchanged, or "
            "all are in reverse order. *Do not use.*",
            "another_robot_fits": "With another robot, each target is within 5 mm of one place on the flange "
            "in 80 % of the observations. *Do not use.*",
            "observations_out_of_order": "Readings fit the joint angles of another row, loaded readings fit "
            "the unloaded readings of another row, or forces rise by one step from row to row. *Do not use.*",
            "targets_swapped": "Targets are at the places of other targets in the unloaded readings, the "
            "loaded readings or both. *Do not use.*",
            "target_off_model": "A target is over 20 mm from its median place on the flange, for no reason "
            "above. *Do not use.* If all targets of an observation are over 2 mm from their places, and ten "
            "times as far as usual: *use with care*. In a geometry: the residual exceeds 1 mm, or links are "
            "over 20 mm or 0.1 rad off the model.",
            "target_moved": "The distance between two targets changed by over 0.1 mm from one observation to "
            "the next, and kept the new value. *Do not use.*",
            "targets_not_rigid": "A distance between two targets differs from its median. *Do not use.*",
            "duplicated_observation": "Two rows are equal to the last digit. *Do not use.*",
            "force_sign_suspect": "The work of the load on the joints is negative. *Do not use.*",
            "load_point_refuted": "The reading of the hook refutes the stated load point. *Do not use.*",
            "deflection_against_force": "One observation fits if its load is reversed; or, in all "
            "observations, unloaded and loaded readings of some targets are exchanged. *Do not use.*",
            "sigma_suspect": "The stated noise is above 1 mm: *do not use*. Distances between targets "
            "scatter by more than twice the stated noise: *use with care*.",
            "deflection_implausibly_large": "A deflection is above 20 mm, or the loaded readings are "
            "deflections. *Do not use.*",
            "deflection_implausibly_small": "No deflection is above 5 µm, or readings have equal "
            "digits in both states. *Do not use.*",
            "residual_outlier": "A residual is far larger than the others. *Use with care.*",
            "drift_in_time": "The unloaded targets drift. *Use with care.*",
            "repeated_readings": "Two targets have equal readings: *do not use*. Repeated postures scatter "
            "more than the stated noise: *use with care*. If not: a remark.",
            "joint_outside_limits": "A joint angle is beyond the model's limits. *Use with care.*",
            "deflections_unexplained": "Remark: the joints explain less than half of the median deflection.",
            "deflection_below_noise": "Remark: the observation contributes little.",
            "zero_load": "Remark: the observation contributes little. Without any load: *do not use*.",
            "target_name_suspect": "Remark: a target is in under a tenth of the rows.",
            "angle_rounded": "Remark: 1.57 for π/2.",
            "encoder_against_torque": "An encoder turned against its torque: a sign is wrong, or loaded and "
            "unloaded readings are exchanged.",
            "encoder_deflection_implausibly_large": "The angle of an encoder changed by more than 20 mrad.",
        },
        "Result of a run": {
            "alternative_explains_better": "The readings fit far better after a change of the data, such as "
            "load point and target exchanged, or with another cause. *Do not use*; *use with care* if a load "
            "hardly matters or links may bend.",
            "no_joint_identified": "No joint has a stiffness with an upper limit. *Do not use.*",
            "no_residual_freedom": "There are as many parameters as readings. *Do not use*; if the noise is "
            "stated, *use with care*.",
            "joint_poorly_known": "A joint that may carry 5 % of the deflection is known worse than the "
            f"goal: the ends of its interval are more than a factor of {GOAL:g} apart. *Use with care.*",
            "stiffness_negative": "The stiffness of a joint is negative: *use with care* for the run, *do "
            "not use* for the joint.",
            "stiffness_implausible": "The stiffness of the named joint is outside 10³ to 10⁹ N·m/rad. "
            "*Do not use.*",
            "residuals_exceed_sigma": "The model is wrong, or the stated sigma is too small. *Do not use* if "
            "the RMS of the residuals exceeds 3 sigma, *use with care* above 1.1 sigma (p < 0.001; 1.5 sigma "
            "with elastic links) and after the action `omit_noise`.",
            "deflection_unexplained": "Something other than the joints deflects, or the model is wrong. "
            "*Use with care* if the model explains less than 70 % of the deflection, *do not use* below "
            "50 %.",
            "masses_contradicted": "The positions fit another mass of the named link (*use with care*), or "
            "no masses within their bounds (*do not use*).",
            "masses_unchecked": "The readings do not check the named masses: also measure with a known "
            "payload.",
            "few_postures": "Fewer than three distinct postures (a joint differs by 5° or more); of "
            "gearboxes, fewer than 4 degrees of freedom.",
            "payload_not_stated": "The robot states no payload, so the unit of forces is unchecked.",
            "stiffness_against_payload": "The stiffnesses are implausible for the payload: the unit of "
            "forces is wrong, or a weight in N was given for a mass.",
            "load_at_target": "The stated load point coincides with a reflector.",
            "complementary_stiffness_matters": "The run neglects the complementary stiffness K_c, which "
            "biases the stiffnesses.",
            "statement_dropped": "What is stated of load and places contradicts the readings, or its fit did "
            "not come to rest, so it was not fitted.",
            "prior_dominates": "The stiffness comes from a data sheet (*prior*), or contradicts it.",
            "cause_fitted": "The readings contradict stated values, so a further cause was fitted.",
            "residuals_vanish": "The residuals are nearly zero: the readings seem computed, not measured.",
            "lack_of_fit": "An F test shows that something other than the joints bends. Set `elasticity` to "
            "`automatic`, so that the readings choose the model.",
            "sigma_implausible": "Sigma, estimated from the residuals, is far above a tracker's noise.",
            "sigma_overstated": "χ²/dof is clearly below 1: sigma is too large, or readings were averaged or "
            "copied.",
            "deflection_remains": "More than 2 % of the deflection remains after unloading. Check tool, hook "
            "and base.",
            "deflections_below_noise": "No target moved by more than the noise.",
            "base_bends": "The stiffness of joint 1 includes the stiffness of the base.",
            "links_or_base": "Either links or the base bend. Turn joint 1 between readings, or put a target "
            "on the base plate.",
            "base_unchecked": "There are too few unloaded postures to estimate the tilt of the base.",
            "links_bend_with_joints": "Links bend in addition to joints. Use the model for predictions, and "
            "do not quote the stiffnesses of the joints.",
            "link_penalty_at_end": "Hardly any link bends (λ ≥ 1), or no penalty is needed (1e-7).",
            "link_penalty_raised": "The duality gap was too large, so a larger penalty of links was used.",
            "loss_not_compared": "There are more than 500 targets, so the loss `huber` was not compared.",
            "solver_disagrees": "Clarabel's own answer is farther than 2e-5 (1e-4 for cones of matrices) "
            "from the proved optimum, or there is none.",
        },
        "Comparison": {
            "no_common_configuration": "Two compared sets have no configuration in common, so the avoided "
            "deflection is predicted, not measured.",
            "configurations_differ": "Configurations of one label differ in posture, load or load point.",
            "encoder_against_difference": "An encoder behind a gearbox does not show the deflection that the "
            "encoders in the loop remove (p < 0.001). *Use with care.*",
            "robot_models_differ": "The robots of the two sets have different kinematics, such as after a "
            "calibration; lengths that differ by over 10 mm, or angles by over 1°: *do not use*.",
        },
        "Prediction, map, plan": {
            "prediction_implausible": "A deflection is above 20 mm, or above 20 times the greatest "
            "deflection of the campaign. *Do not use*: check units.",
            "point_implausible": "A load point or place is over 1.5 m from the flange. Check unit and frame.",
            "numbers_missing": "Some cases have no number (*use with care*), or none has (*do not use*).",
            "beyond_campaign": "Loads or postures are beyond the measured loads or postures.",
            "joint_left_out": "No planned load twists the joint. Add loads in other directions.",
            "joint_stays_uncertain": "The predicted uncertainty of the joint is above 50 %. Add readings, a "
            "larger load, or targets farther from the flange.",
        },
        "Corrected program": {
            "moves_left": "Some moves are not corrected; `trust_routines` may help.",
            "corrections_capped": "Limits reduce some corrections (*use with care*), or all (*do not use*). "
            "Check the load, then raise the limit.",
            "nothing_corrected": "No point is loaded, or each deflection is below its uncertainty.",
            "near_singularity": "A correction turns a joint by more than 0.05 rad. Move the part.",
        },
        "Corrected poses": {
            "prior_stiffness": "The stiffnesses are estimated from the payload: measure a campaign.",
        },
        "Gearboxes": {
            "posture_against_encoders": "The motor's angle is not that of the stated posture: label, sign or "
            "unit.",
            "encoder_referenced_anew": "The twist changed by more than 200 µrad without a torque.",
            "approach_unknown": "Not every posture was read from both sides, so lost motion may be in the "
            "steps.",
            "approaches_alike": "Both sides show no lost motion.",
            "step_off_the_others": "One step does not fit the others: did the load hang?",
            "mass_assumed": "The uncertainty of the mass is not stated, so 1 % is assumed.",
            "check_by_log": "The payload on which the numbers rest.",
            "logs_contradict": "The logs do not belong to one gearbox: another payload, a new reference, or "
            "heat.",
            "gearbox_uncertain": "Fewer than 5 torques, or an interval wider than ± 5 %.",
        },
        "Geometry": {
            "tracker_bumped": "All later readings are displaced.",
            "position_suspect": "A position does not fit.",
            "reading_suspect": "A reading does not fit.",
            "short_arc": "The joint turned by less than 30°.",
            "angle_scale_suspect": "The joint turned by another angle than controller and joint map state.",
            "residuals_below_sigma": "The scatter is below the stated sigma.",
            "sweeps_disagree": "No geometry fits all sweeps, because other joints moved or the arm sagged.",
            "wrist_centres_disagree": "Two wrist centres differ by more than noise.",
            "base_drifted": "The tracker or the base moved.",
            "base_target_moved": "One base target moved.",
            "parameters_not_identified": "The readings do not determine some parameters, or only within "
            "10 mm or 10 mrad.",
            "axes_nearly_parallel": "Some DH parameters are very large. Use the URDF.",
        },
    }
)
"""Meanings by what the finding concerns; *italics* are the best verdict that the finding allows."""
