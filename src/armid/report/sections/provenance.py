"""Section of the run's provenance: digests of files, versions, options, and the resolved study."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import version

from armid.errors import Finding
from armid.estimation.estimate_record import InputDigest
from armid.information.information import FactorOrigin
from armid.report.data.findings import remedy_words
from armid.report.data.page_data import PageData
from armid.report.data.study_toml import study_to_toml
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell

PACKAGES = ("armid", "numpy", "scipy", "plotly")


def show_provenance(page_data: PageData) -> Section:
    """Section of inputs, versions, findings and study."""
    estimate = page_data.run.estimate
    rows = [
        (TableCell(what, kind="path"), TableCell(sha256, kind="digest"))
        for what, sha256 in _with_paths(page_data, estimate.made_from)
    ]
    table = Table(
        "provenance",
        "Inputs, by their sha256",
        (Column("input", words=True), Column("sha256", words=True)),
        rows,
        folded=True,
    )
    origin = page_data.run.made
    made = [
        ("identified", " ".join(filter(None, [origin.at, origin.host and f"on {origin.host}"])) or "not recorded"),
        ("method", estimate.method),
        ("terms", ", ".join(term.name for term in estimate.terms)),
        ("kernel", _kernel(estimate.made_by)),
        ("time", f"{estimate.seconds:.2f} s"),
        *page_versions(),
    ]
    content = {
        "made": made,
        "study": study_to_toml(page_data.study),
        "folder": page_data.study.folder,
        "findings": findings_of(estimate.findings),
    }
    return Section("Provenance", content, (table,))


def page_versions() -> list[tuple[str, str]]:
    """Versions of the packages and of Python that make a page, as name and text."""
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return [("page made with", packages), ("Python", platform.python_version())]


def findings_of(findings: Sequence[Finding]) -> list[tuple[str, str, str, str, str]]:
    """Code, severity, channel, evidence and remedy of each finding, as text."""
    return [(f.code, f.severity, f.channel, f.evidence, remedy_words(f)) for f in findings]


def _kernel(made_by: FactorOrigin) -> str:
    """Build of the kernel and its factorisation, as text."""
    ways = {"qr": "QR factors", "cholesky": "Cholesky factors", "products": "products of columns"}
    return f"{made_by.kernel}, {ways.get(made_by.method, made_by.method)}" if made_by.method else made_by.kernel


def _with_paths(page_data: PageData, digests: Sequence[InputDigest]) -> list[tuple[str, str]]:
    """Role and path of each input as text, and the sha256 of the input."""
    paths = iter(each.path for each in page_data.study.recordings)
    named: list[tuple[str, str]] = []
    for each in digests:
        path = next(paths, "") if each.role in ("train", "validate") else ""
        named.append((f"{each.role}: {path}" if path else each.role, each.sha256))
    return named
