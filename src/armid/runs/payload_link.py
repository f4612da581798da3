"""Link that carries a payload, and a test that the measured torque agrees with a load on this link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding, StudyError
from armid.estimation.update.payload_misfit import PayloadMisfit, misfit_of
from armid.estimation.update.stacked_problem import stack_problems
from armid.estimation.whitened_system import whiten
from armid.runs.new_recordings import NewRecordings, link_columns, load_columns
from armid.runs.run import Run


@dataclass(frozen=True, eq=False, slots=True)
class PayloadLink:
    """Link that carries a payload, and frame of the payload's parameters.

    Attributes:
        link: Name of the link.
        frame: Name of the frame.
        columns: Matrix that maps the ten parameters of a payload in this frame to base parameters, shape (b, 10).
        to_link: Matrix that maps the ten parameters in this frame to the ten parameters in the frame of the link,
            shape (10, 10).
    """

    link: str
    frame: str
    columns: Array
    to_link: Array


def payload_link(run: Run, name: str | None = None) -> PayloadLink:
    """Looks up the link that carries a payload.

    Args:
        run: Run of the arm.
        name: Name of a moving link, in whose frame the parameters of the payload are; by default the link and
            frame of the tip.

    Raises:
        RobotError: No link is named, and the tip is fixed to the base, or its link carries further joints.
        StudyError: There is no such link, or the run's model has no rigid bodies.
    """
    robot = run.robot
    if name is None or name == robot.tip.name:
        columns, to_link = load_columns(run)
        return PayloadLink(robot.links[robot.tip.parent].name, robot.tip.name, columns, to_link)
    names = [link.name for link in robot.links]
    if name not in names:
        raise StudyError(
            f"The load cannot be on the link {name!r}, because {robot.name} has no moving link of this name.",
            possible=", ".join(names),
            remedy="name one of the moving links; a link that is fixed to a moving link counts as a part of it.",
        )
    return PayloadLink(name, name, link_columns(run, names.index(name))[1], np.eye(10))


def fit_finding(
    new_recordings: NewRecordings,
    place: PayloadLink,
    own: NDArray[np.bool_],
    known: Array | None,
) -> tuple[PayloadMisfit, Finding | None]:
    """Tests whether a load on the given link explains the new recordings; if not, a finding names a better link.

    Args:
        new_recordings: The recordings with the payload.
        place: Link that carries the payload according to the user.
        own: Mask of the base parameters with separate values in the new recordings, shape (b,).
        known: Known parameters of the payload, NaN for unknown ones, shape (10,); `None` if all are unknown.

    Returns:
        The misfit with a load on that link, and the finding; `None` instead of the finding if the misfit is not
        significant.
    """
    run, new = new_recordings.run, new_recordings.new
    alone = whiten(new)

    def misfit(columns: Array, known: Array | None) -> PayloadMisfit:
        stacked = stack_problems(new_recordings.earlier, run.estimate.fit, new, own, columns)
        return misfit_of(stacked, new, alone, new.scale_deviation, known)

    found = misfit(place.columns, known)
    if not found.significant.any():
        return found, None
    # The centre of mass was given in the frame of the named link.
    mass = None if known is None else np.append(known[:1], np.full(9, np.nan))
    others = {
        link.name: misfit(link_columns(run, k)[1], mass)
        for k, link in enumerate(run.robot.links)
        if link.name != place.link
    }
    best = min(others, key=lambda name: others[name].cost, default=None)
    if best is not None and others[best].cost >= found.cost:
        best = None
    return found, _finding(new_recordings, place, own, found, best, None if best is None else others[best])


def _finding(
    new_recordings: NewRecordings,
    place: PayloadLink,
    own: NDArray[np.bool_],
    found: PayloadMisfit,
    best: str | None,
    better: PayloadMisfit | None,
) -> Finding:
    """Finding that a load on the given link does not explain the torque, with a better link if there is one.

    Args:
        new_recordings: The recordings with the payload.
        place: Link that carries the payload according to the user.
        own: Mask of the base parameters with separate values in the new recordings, shape (b,).
        found: Misfit with a load on this link.
        best: Name of the link with the smallest misfit; `None` if there is no better link.
        better: Misfit with a load on the link `best`; `None` if there is no better link.
    """
    joints = np.flatnonzero(found.significant)
    ratio = found.residual[joints] / found.alone[joints]
    times = f"{ratio.min():.1f}" if ratio.max() - ratio.min() < 0.05 else f"{ratio.min():.1f} to {ratio.max():.1f}"
    names = ", ".join(new_recordings.run.robot.joint_names[j] for j in joints)
    check = "check that the arm had no contact, and that the load was attached firmly and all the time."
    if not own.any():
        check = f"leave --same-friction out, since friction may have changed; {check}"
    if best is None or better is None:
        remedy = f"a load on another link does not explain the torque better; {check}"
    elif better.significant.any():
        remedy = f"a load on the link {best} explains the torque better, but not completely (--link {best}); {check}"
    else:
        remedy = f"a load on the link {best} explains the torque: if it is attached there, give --link {best}."
    return Finding(
        "payload-misfit",
        "warning",
        names,
        f"A load on the link {place.link} does not explain the torque: the residual is {times} times that of the "
        "same model fitted to these recordings alone. The load may be attached to another link; its parameters and "
        "their intervals are then wrong.",
        remedy,
    )
