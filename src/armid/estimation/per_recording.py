"""Shared inertial parameters with friction of its own for each recording.

Friction changes with temperature and age, links do not. Each recording's rows then touch the shared parameters and
its own copies of the others, named `FV_1[1]`, `FV_1[2]`, …; the factors are rearranged, the data are not read again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.information.information import Information, JointFactors
from armid.kernel import factor_columns

__all__ = ["separate_by_recording"]


def separate_by_recording(information: Information, own: NDArray[np.bool_]) -> Information:
    """Give each recording its own copy of some parameters.

    Args:
        information: Blocks of several recordings.
        own: Which of the b parameters each recording has for itself, shape (b,).

    Returns:
        Information about the shared parameters followed by each recording's own.
    """
    recordings = np.unique(information.recording)
    if len(recordings) < 2 or not own.any():
        return information
    shared = np.flatnonzero(~own)
    separate = np.flatnonzero(own)
    names = tuple(information.names[k] for k in shared) + tuple(
        f"{information.names[k]}[{r + 1}]" for r in recordings for k in separate
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


def _places(
    parameters: NDArray[np.int32],
    own: NDArray[np.bool_],
    shared: NDArray[np.intp],
    separate: NDArray[np.intp],
    copy: int,
) -> NDArray[np.int64]:
    """New numbers of a joint's parameters for the recording number `copy`."""
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
    """New numbers that a joint's rows touch in any recording, rising."""
    places = [_places(parameters, own, shared, separate, copy) for copy in range(copies)]
    return np.unique(np.concatenate(places)).astype(np.int32)
