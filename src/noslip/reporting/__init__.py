"""A report of one primitive, to mail or to print: what was learned, from what, how it holds."""

from noslip.reporting.content import report
from noslip.reporting.document import to_html, to_pdf, write_report
from noslip.reporting.values import Picture, Report, Table, Value

__all__ = ["Picture", "Report", "Table", "Value", "report", "to_html", "to_pdf", "write_report"]
