"""Catalogue of sections, in the order of the page.

A section is a function that makes a `Section` from the page data of a run; the template of the same name shows its
data. The function returns `None` if the run has no data for the section.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from armid.report.data.page_data import PageData
from armid.report.section import Section
from armid.report.sections.consistency import show_consistency
from armid.report.sections.excitation import show_excitation
from armid.report.sections.friction import show_friction
from armid.report.sections.groupings import show_groupings
from armid.report.sections.link_properties import show_link_properties
from armid.report.sections.method_comparison import show_methods
from armid.report.sections.parameters import show_parameters
from armid.report.sections.provenance import show_provenance
from armid.report.sections.residuals import show_residuals
from armid.report.sections.standard_parameters import show_standard_parameters
from armid.report.sections.torque import show_torque
from armid.report.sections.verdict import show_verdict

__all__ = ["SECTIONS"]

SECTIONS: Mapping[str, Callable[[PageData], Section | None]] = {
    "verdict": show_verdict,
    "link-properties": show_link_properties,
    "torque": show_torque,
    "residuals": show_residuals,
    "friction": show_friction,
    "parameters": show_parameters,
    "standard-parameters": show_standard_parameters,
    "groupings": show_groupings,
    "consistency": show_consistency,
    "method-comparison": show_methods,
    "excitation": show_excitation,
    "provenance": show_provenance,
}
