"""Records of a monitor and its alarms, for JSON and CSV files."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armid.runs.monitoring.monitor import NO_SAFETY, Alarm, Monitor, Watched
from armid.runs.monitoring.tip_wrench import NAMES, TipWrench
from armid.study.storage.records import finding_record


def monitor_record(monitor: Monitor, watched: Sequence[tuple[str, Watched]]) -> dict[str, Any]:
    """JSON object with a monitor and the alarms of recordings; `watched` contains the path of each recording."""
    found = monitor.thresholds
    joints = monitor.run.robot.joint_names
    units = ["N" if joint.is_prismatic else "N·m" for joint in monitor.run.robot.joints]
    return {
        "notice": NO_SAFETY,
        "run": monitor.run.folder,
        "observer": monitor.options.kind,
        "gain": monitor.options.gain_at(monitor.rate),
        "sample_rate": monitor.rate,
        "false_alarms_per_hour": found.rate,
        "promised": found.promised,
        "smallest_promised_per_hour": found.smallest if math.isfinite(found.smallest) else None,
        "unseen": {"source": monitor.source, "seconds": found.seconds},
        "joints": [
            {
                "joint": name,
                "unit": unit,
                "mean_threshold": found.mean[j],
                "mean_if_constant": found.constant[j],
                "follows_motion": bool(found.follows[j]),
                "factor": found.factor[j],
                "scale": found.scale[j],
                "at_rest": found.friction[j],
            }
            for j, (name, unit) in enumerate(zip(joints, units, strict=True))
        ],
        "recordings": [
            {
                "path": path,
                "seconds": each.seconds,
                "alarms": [_alarm_record(alarm) for alarm in each.alarms],
                "findings": [finding_record(finding) for finding in each.findings],
            }
            for path, each in watched
        ],
        "findings": [finding_record(finding) for finding in monitor.findings],
    }


def _alarm_record(alarm: Alarm) -> dict[str, Any]:
    return {
        "start": alarm.start,
        "duration": alarm.duration,
        "joint": alarm.joint,
        "joints": alarm.joints,
        "time": alarm.time,
        "size": alarm.size,
        "threshold": alarm.threshold,
        "external": alarm.external,
        "wrench": None if alarm.wrench is None else wrench_record(alarm.wrench),
    }


def wrench_record(wrench: TipWrench) -> dict[str, Any]:
    """JSON object with a wrench; the standard deviation of a component that is not determined is null."""
    return {
        "axes": "base",
        "components": NAMES,
        "value": wrench.value,
        "deviation": [x if math.isfinite(x) else None for x in wrench.deviation.tolist()],
        "covariance": wrench.covariance,
        "undetermined": wrench.undetermined,
        "length": wrench.length,
        "misfit": wrench.misfit if math.isfinite(wrench.misfit) else None,
    }


def monitor_table(watched: Watched, joints: Sequence[str]) -> str:
    """CSV text with time, external torque and threshold of each joint, and 1 where a joint exceeds its threshold."""
    text = io.StringIO()
    names = ["t", *(f"{kind}{j + 1}" for kind in ("tau_ext", "threshold", "exceeded") for j in range(len(joints)))]
    text.write(",".join(names) + "\n")
    for part, along in zip(watched.parts, watched.thresholds, strict=True):
        over = (np.abs(part.external) > along) & part.usable
        rows = np.column_stack([part.time, part.external, along, over])
        np.savetxt(text, rows, delimiter=",", fmt=["%.17g"] + ["%.9g"] * (2 * len(joints)) + ["%d"] * len(joints))
    return text.getvalue()
