"""The page of a vignetting: the light of every plane over the frame, and its colour."""

from station.reports.field.camera_section import light_figures
from station.reports.page import Figures
from station.reports.report import Report
from station.reports.report_page import report_page


def vignetting_page(report: Report) -> str:
    """The page of all planes."""
    lights = {plane.name: plane.estimate.surface.light for plane in report.planes if plane.estimate is not None}
    return report_page(report, summary=[Figures(light_figures(lights), wide=True)] if lights else [])
