"""Kinematics by matrices from the textbooks, by a product of exponentials, and as Pinocchio reads URDFs."""

import math

import numpy as np
import pinocchio as pin


def product_of_exponentials(chain, q):
    """Return the flange's pose, the frames of the joints and the spatial Jacobian, in extended precision."""
    angles, pose, frames, columns = iter(q.astype(np.longdouble)), np.eye(4, dtype=np.longdouble), [], []
    for each in chain.joints:
        step = np.eye(4, dtype=np.longdouble)
        step[:3, :3], step[:3, 3] = each.rotation, each.translation
        pose = pose @ step
        if not each.is_moving:
            continue
        axis = pose[:3, :3] @ each.axis
        slides = each.kind == "prismatic"
        columns.append(np.concatenate([axis, 0 * axis] if slides else [np.cross(pose[:3, 3], axis), axis]))
        angle, (x, y, z) = next(angles), each.axis.astype(np.longdouble)
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(4, dtype=np.longdouble)
        if slides:
            turn[:3, 3] = angle * each.axis
        else:
            turn[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
        pose = pose @ turn
        frames.append(pose)
    return pose, np.array(frames), np.stack(columns, axis=1)


def standard(row, q):
    """Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, eq. 3.10."""
    ct, st_ = math.cos(q + row.theta), math.sin(q + row.theta)
    ca, sa = math.cos(row.alpha), math.sin(row.alpha)
    return np.array(
        [
            [ct, -st_ * ca, st_ * sa, row.a * ct],
            [st_, ct * ca, -ct * sa, row.a * st_],
            [0.0, sa, ca, row.d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def modified(row, q):
    """Craig, Introduction to Robotics, eq. 3.6."""
    ct, st_ = math.cos(q + row.theta), math.sin(q + row.theta)
    ca, sa = math.cos(row.alpha), math.sin(row.alpha)
    return np.array(
        [
            [ct, -st_, 0.0, row.a],
            [st_ * ca, ct * ca, -sa, -sa * row.d],
            [st_ * sa, ct * sa, ca, ca * row.d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


TEXTBOOK = {"standard": standard, "modified": modified}


def flange_by_textbook(rows, convention, q):
    pose = np.eye(4)
    for row, value in zip(rows, q, strict=True):
        if row.kind == "prismatic":
            pose = pose @ TEXTBOOK[convention](row.model_copy(update={"d": row.d + value}), 0.0)
        else:
            pose = pose @ TEXTBOOK[convention](row, value)
    return pose


def flange_by_pinocchio(text, angles, base, flange):
    """Parse the original document, and ask for the flange in the base."""
    model = pin.buildModelFromXML(text)
    q = pin.neutral(model)
    for name, angle in angles.items():
        joint = model.joints[model.getJointId(name)]
        value = [angle] if joint.nq == 1 else [math.cos(angle), math.sin(angle)]
        q[joint.idx_q : joint.idx_q + joint.nq] = value
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    frame = [data.oMf[model.getFrameId(link, pin.FrameType.BODY)] for link in (base, flange)]
    return (frame[0].inverse() * frame[1]).homogeneous
