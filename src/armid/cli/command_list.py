"""List of all commands of `armid`, in the order of the help."""

from __future__ import annotations

from collections.abc import Callable

from armid.cli.commands.base_parameters import base
from armid.cli.commands.bench import bench
from armid.cli.commands.certify_parameters import certify
from armid.cli.commands.demo import demo
from armid.cli.commands.doctor import doctor
from armid.cli.commands.export import export
from armid.cli.commands.identify import identify
from armid.cli.commands.payload import payload
from armid.cli.commands.predict import predict
from armid.cli.commands.recalibrate import recalibrate
from armid.cli.commands.report import report
from armid.cli.commands.thesis import thesis
from armid.cli.commands.track import track
from armid.cli.commands.validate import validate
from armid.cli.fleets.fleet import fleet
from armid.cli.monitoring.monitor import monitor
from armid.cli.motion.excite import excite
from armid.cli.motion.preview import preview
from armid.cli.motion.simulate import simulate
from armid.cli.servos.servo import servo

COMMANDS: tuple[Callable[..., None], ...] = (
    base,
    excite,
    simulate,
    identify,
    servo,
    fleet,
    doctor,
    validate,
    predict,
    certify,
    payload,
    recalibrate,
    track,
    monitor,
    report,
    preview,
    export,
    demo,
    thesis,
    bench,
)
