"""The only file formats: atomic, versioned, hashed, without pickle."""

from rm3d_plugin.storage.click_files import click_classes, read_clicks, write_clicks
from rm3d_plugin.storage.clicks import Click, ClickFileError
from rm3d_plugin.storage.files import (
    DamagedFileError,
    atomic_write,
    content_key,
    content_of,
    hash_arrays,
    read_json,
    read_npz,
    remove_unfinished,
    write_bytes,
    write_json,
    write_npz,
    write_text,
)
from rm3d_plugin.storage.fingerprint import Fingerprinted
from rm3d_plugin.storage.instance_box import InstanceBox
from rm3d_plugin.storage.label_store import LabelStore, LabelStoreError, SceneEntry
from rm3d_plugin.storage.scene_cache import SceneCache
from rm3d_plugin.storage.sealed_json import read_sealed, write_sealed

__all__ = [
    'Click',
    'ClickFileError',
    'DamagedFileError',
    'Fingerprinted',
    'InstanceBox',
    'LabelStore',
    'LabelStoreError',
    'SceneCache',
    'SceneEntry',
    'atomic_write',
    'click_classes',
    'content_key',
    'content_of',
    'hash_arrays',
    'read_clicks',
    'read_json',
    'read_npz',
    'read_sealed',
    'remove_unfinished',
    'write_bytes',
    'write_clicks',
    'write_json',
    'write_npz',
    'write_sealed',
    'write_text',
]
