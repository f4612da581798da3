"""Information with the same links for all recordings, and separate friction or offsets for each recording.

Friction changes with temperature and age, and sensors are zeroed again; the links stay the same. Therefore each
recording gets separate copies of the parameters that may change, named `FV_1[1]`, `FV_1[2]`, … by the number of the
recording. The rows of a recording depend on the common parameters and on the copies of this recording. Only the
factors are rearranged; the data are not read again.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.estimation.problem import StandardParameters
from armid.information.information import Information, JointFactors
from armid.kernel import factor_columns
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.parameter_name import ParameterName
from armid.model.terms import Offset
from armid.model.torque_law_expression import symbols


def offset_names(model: DynamicsModel) -> tuple[str, ...]:
    """Names of the standard parameters of a model that are offsets of the torque."""
    return tuple(parameter.name for parameter in model.parameters if parameter.kind == Offset.name)


def changing_parameters(model: DynamicsModel) -> NDArray[np.bool_]:
    """Mask (p,) of the standard parameters that may differ between recordings: friction and offsets."""
    changing = np.zeros(len(model.parameters), dtype=np.bool_)
    for column, (_, law) in zip(model.law_columns, model.laws, strict=True):
        changing[column] = "ddq" not in symbols(law.expression)
    return changing


def separate_by_recording(information: Information, own: NDArray[np.bool_]) -> Information:
    """Gives each recording a separate copy of some parameters.

    Args:
        information: Blocks of several recordings.
        own: Mask of the b parameters of which each recording gets a copy, shape (b,).

    Returns:
        Information whose parameters are the common parameters, followed by the copies of each recording.
    """
    recordings = np.unique(information.recording)
    if len(recordings) < 2 or not own.any():
        return information
    shared = np.flatnonzero(~own)
    separate = np.flatnonzero(own)
    names = tuple(information.names[k] for k in shared) + tuple(
        information.names[k].of_recording(int(r) + 1) for r in recordings for k in separate
    )
    joints: list[JointFactors] = []
    for joint in information.joints:
        parameters = _parameters(joint.parameters, own, shared, separate, len(recordings))
        width = len(parameters) + 1
        R = np.zeros((information.blocks, width, width))
        for block, of in enumerate(information.recording):
            copy = int(np.searchsorted(recordings, of))
            target = _places(joint.parameters, own, shared, separate, copy)
            columns = np.zeros((width, joint.R.shape[1]))
            columns[np.searchsorted(parameters, target)] = joint.R[block, :, :-1].T
            columns[-1] = joint.R[block, :, -1]
            R[block] = factor_columns(columns)[0]
        joints.append(JointFactors(parameters, R))
    return replace(information, names=names, joints=tuple(joints))


def contrasted(information: Information, names: Collection[str]) -> Information:
    """Adds parameters for the differences between recordings: the deviation of a parameter from its mean.

    A parameter with the value v_r in recording r, of R recordings, has the mean v = Σ v_r / R. The added parameters
    are d_r = v_r - v for all recordings except the last, because their sum is zero. The original parameter keeps its
    position and now stands for v.

    Args:
        information: Blocks of several recordings.
        names: Parameters that may differ between recordings.

    Returns:
        Information with the added parameters `FO_1~1`, `FO_1~2`, … last; unchanged if there is only one recording.
    """
    recordings = np.unique(information.recording)
    more = len(recordings) - 1
    own = [k for k, name in enumerate(information.names) if name in names] if more else []
    if not own:
        return information
    sign = (information.recording[:, None] == recordings[:-1]) * 1.0
    sign[information.recording == recordings[-1]] = -1.0
    joints: list[JointFactors] = []
    for joint in information.joints:
        at = [k for k, parameter in enumerate(joint.parameters) if parameter in own]
        added = [information.count + own.index(int(joint.parameters[k])) * more + r for k in at for r in range(more)]
        columns = joint.R[:, :, at, None] * sign[:, None, None, :]
        wide = np.concatenate(
            [joint.R[:, :, :-1], columns.reshape(*joint.R.shape[:2], -1), joint.R[:, :, -1:]], axis=2
        )
        factors = [factor_columns(np.ascontiguousarray(each.T))[0] for each in wide]
        joints.append(JointFactors(np.append(joint.parameters, added), np.stack(factors)))
    names_of = [ParameterName(f"{information.names[k]}~{r + 1}") for k in own for r in recordings[:-1]]
    return replace(information, names=(*information.names, *names_of), joints=tuple(joints))


def standard_per_recording(
    standard: StandardParameters, base: BaseParameters | None, information: Information
) -> StandardParameters:
    """Standard parameters of information in which `separate_by_recording` has copied parameters.

    A standard parameter gets copies if all base parameters that contain it have copies. If a common base parameter
    contains it, too, it stays common; an example is an offset that is regrouped with a constant gravity torque.

    Args:
        standard: Standard parameters of the model, before the separation.
        base: Base parameters of the model, for their names.
        information: Information with or without copies of parameters.
    """
    if base is None or (information.count == len(base.names) and tuple(information.names) == tuple(base.names)):
        return standard
    index = {name: k for k, name in enumerate(base.names)}
    row = np.array([index[name.of_all] for name in information.names])
    copy = np.array([name.recording or 0 for name in information.names])
    copied = np.zeros(len(base.names), dtype=np.bool_)
    copied[row[copy > 0]] = True
    seen = standard.regrouping != 0.0
    own = seen[copied].any(axis=0) & ~seen[~copied].any(axis=0)
    own[standard.inertial] = False
    source = [(k, 0) for k in np.flatnonzero(~own)]
    source += [(k, c) for c in np.unique(copy[copy > 0]) for k in np.flatnonzero(own)]
    which, number = np.array([k for k, _ in source]), np.array([c for _, c in source])
    regrouping = standard.regrouping[row][:, which] * ((number == 0) | (number == copy[:, None]))
    place = {int(k): at for at, (k, c) in enumerate(source) if c == 0}
    names = [standard.names[k].of_recording(int(c)) if c else standard.names[k] for k, c in source]
    return StandardParameters(
        tuple(names),
        tuple(standard.units[k] for k in which),
        regrouping,
        np.array([[place[int(k)] for k in link] for link in standard.inertial], dtype=np.intp).reshape(-1, 10),
        standard.links,
        standard.nonnegative[which],
        None if standard.nominal is None else standard.nominal[which],
        None if standard.added is None else standard.added[which],
    )


def _places(
    parameters: NDArray[np.int32],
    own: NDArray[np.bool_],
    shared: NDArray[np.intp],
    separate: NDArray[np.intp],
    copy: int,
) -> NDArray[np.int64]:
    """New indices of the parameters of a joint, for the rows of one recording, shape (parameters,).

    Args:
        parameters: Indices of the joint's parameters before the separation.
        own: Mask of the b parameters of which each recording gets a copy, shape (b,).
        shared: Indices of the common parameters before the separation.
        separate: Indices of the copied parameters before the separation.
        copy: Index of the recording.
    """
    first = len(shared) + copy * len(separate)
    return np.where(
        own[parameters], first + np.searchsorted(separate, parameters), np.searchsorted(shared, parameters)
    )


def _parameters(
    parameters: NDArray[np.int32],
    own: NDArray[np.bool_],
    shared: NDArray[np.intp],
    separate: NDArray[np.intp],
    copies: int,
) -> NDArray[np.int32]:
    """New indices, in ascending order, of the parameters on which a joint's rows depend in at least one recording.

    Args:
        parameters: Indices of the joint's parameters before the separation.
        own: Mask of the b parameters of which each recording gets a copy, shape (b,).
        shared: Indices of the common parameters before the separation.
        separate: Indices of the copied parameters before the separation.
        copies: Number of recordings.
    """
    places = [_places(parameters, own, shared, separate, copy) for copy in range(copies)]
    return np.unique(np.concatenate(places)).astype(np.int32)
