"""Labels from a person: click files in and out, the log of a session, and the session itself."""

from rm3d_plugin.annotation.click_log import ClickLog
from rm3d_plugin.annotation.session import Session
from rm3d_plugin.annotation.suggestions import Suggestion
from rm3d_plugin.storage import Click, ClickFileError, InstanceBox, read_clicks, write_clicks

__all__ = ['Click', 'ClickFileError', 'ClickLog', 'InstanceBox', 'Session', 'Suggestion', 'read_clicks', 'write_clicks']
