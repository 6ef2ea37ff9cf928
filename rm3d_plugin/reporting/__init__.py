"""From the records of a run to its report; inspection and replay of merges."""

from rm3d_plugin.reporting.report_hook import ReportHook

__all__ = ['ReportHook']
