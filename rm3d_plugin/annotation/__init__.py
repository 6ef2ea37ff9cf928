"""Labels from a person: click files in and out, and the log of a session."""

from rm3d_plugin.annotation.click_log import ClickLog
from rm3d_plugin.storage.click_files import Click, ClickFileError, read_clicks, write_clicks

__all__ = ['Click', 'ClickFileError', 'ClickLog', 'read_clicks', 'write_clicks']
