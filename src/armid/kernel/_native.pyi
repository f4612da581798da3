from typing import Any

from numpy.typing import NDArray

_A = NDArray[Any]

class Arm:
    def __init__(self, parent: _A, prismatic: _A, axis: _A, rotation: _A, translation: _A, gravity: _A) -> None: ...

class Tape:
    def __init__(self, sizes: _A, constants: _A, runs: _A, operands: _A, results: _A) -> None: ...
    @staticmethod
    def operations() -> list[str]: ...
    def run(self, out: _A, /, *inputs: _A) -> int: ...

class ServoArrays:
    def __init__(
        self,
        gains: _A,
        first: _A,
        operation: _A,
        constant: _A,
        link: _A,
        joint: _A,
        weight: _A,
        value: _A,
    ) -> None: ...

class ParameterArrays:
    def __init__(
        self,
        count: int,
        offset: _A,
        target: _A,
        parameter: _A,
        law: _A,
        joint: _A,
        input_joint: _A,
        input_parameter: _A,
        input: _A,
    ) -> None: ...

def roll_out(
    isa: str,
    arm: Arm,
    inertial: _A,
    servos: ServoArrays,
    step: float,
    steep: float,
    position: _A,
    torque: _A,
    q: _A,
    dq: _A,
    /,
) -> int: ...
def roll_out_sensitivities(
    isa: str,
    arm: Arm,
    inertial: _A,
    servos: ServoArrays,
    step: float,
    steep: float,
    parameters: ParameterArrays,
    position: _A,
    torque: _A,
    q: _A,
    dq: _A,
    start_q: _A,
    start_dq: _A,
    every: int,
    out: _A,
    /,
) -> None: ...
def instruction_sets() -> list[str]: ...
def regressor(isa: str, arm: Arm, q: _A, dq: _A, ddq: _A, out: _A, /) -> None: ...
def columns(
    isa: str,
    arm: Arm,
    offset: _A,
    target: _A,
    term: _A,
    q: _A,
    dq: _A,
    ddq: _A,
    torque: _A,
    terms: _A,
    out: _A,
    /,
) -> None: ...
def inverse_dynamics(isa: str, arm: Arm, inertial: _A, q: _A, dq: _A, ddq: _A, out: _A, /) -> None: ...
def mass_matrix(isa: str, arm: Arm, inertial: _A, q: _A, out: _A, /) -> None: ...
def factor(
    isa: str,
    arm: Arm,
    offset: _A,
    target: _A,
    term: _A,
    q: _A,
    dq: _A,
    ddq: _A,
    torque: _A,
    terms: _A,
    mask: _A,
    bounds: _A,
    by_gram: bool,
    threads: int,
    out: _A,
    /,
) -> None: ...
def factor_columns(isa: str, x: _A, bounds: _A, out: _A, /) -> None: ...
def decimate(
    isa: str,
    arm: Arm,
    offset: _A,
    target: _A,
    term: _A,
    q: _A,
    dq: _A,
    ddq: _A,
    torque: _A,
    terms: _A,
    taps: _A,
    step: int,
    first: int,
    out: _A,
    /,
) -> None: ...
def play(isa: str, x: _A, column: _A, width: _A, out: _A, known: _A, /) -> None: ...
def columns_adjoint(
    isa: str,
    arm: Arm,
    offset: _A,
    target: _A,
    q: _A,
    dq: _A,
    ddq: _A,
    cotangent: _A,
    q_bar: _A,
    dq_bar: _A,
    ddq_bar: _A,
    /,
) -> None: ...
def information(
    isa: str,
    arm: Arm,
    offset: _A,
    target: _A,
    term: _A,
    parameter: _A,
    q: _A,
    dq: _A,
    ddq: _A,
    terms: _A,
    weight: _A,
    out: _A,
    /,
) -> None: ...
def information_adjoint(
    isa: str,
    arm: Arm,
    offset: _A,
    target: _A,
    term: _A,
    parameter: _A,
    q: _A,
    dq: _A,
    ddq: _A,
    terms: _A,
    weight: _A,
    slopes: _A,
    q_bar: _A,
    dq_bar: _A,
    ddq_bar: _A,
    terms_bar: _A,
    /,
) -> None: ...
def reweighted(
    isa: str,
    offset: _A,
    parameter: _A,
    products: _A,
    sign: _A,
    rows: _A,
    passes: int,
    settled: float,
    floor: float,
    ridge: float,
    x: _A,
    sigma: _A,
    /,
) -> None: ...
def zero_phase(
    isa: str,
    x: _A,
    sections: _A,
    reach: int,
    rate: float,
    least_value: float,
    least_first: float,
    piece: int,
    threads: int,
    value: _A,
    first: _A,
    second: _A,
    /,
) -> None: ...
def speeds(isa: str, x: _A, half: int, scale: float, begin: int, out: _A, /) -> None: ...
def filter_columns(isa: str, x: _A, sections: _A, reach: int, first: int, step: int, out: _A, /) -> None: ...
def third_differences(isa: str, x: _A, time: _A, begin: int, out: _A, smallest: _A, /) -> None: ...
def decimate_channels(isa: str, x: _A, taps: _A, step: int, out: _A, /) -> None: ...
def heights(isa: str, padded: _A, length: int, height: _A, difference: _A, /) -> None: ...
