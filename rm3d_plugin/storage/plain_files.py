"""What readers of data sets ask of folders and texts: which files count, what their text is, what a number is."""

from collections.abc import Iterable
from pathlib import Path

from rm3d_plugin.storage.text_columns import plain_text
from rm3d_plugin.structures import SceneError


def files_ending(folder: Path, ending: str, large: bool = False) -> list[Path]:
    """Files of a folder with an ending, by name. Hidden ones, as macOS leaves them (``._000000.bin``), do not count.

    Args:
        folder: Where they lie.
        ending: In small letters.
        large: The ending may have large letters; False: files are found again by their names without it.

    Raises:
        SceneError: An ending is spelled in large letters, and may not be: the file would be passed over.
    """
    found = [path for path in sorted(visible(folder.glob('*'))) if path.suffix.lower() == ending]
    for path in found:
        if path.suffix != ending and not large:
            raise SceneError(f'{path}: expected the ending {ending} in small letters; rename the file')
    return found


def visible(paths: Iterable[Path]) -> Iterable[Path]:
    """Files and folders that are not hidden."""
    return (path for path in paths if not path.name.startswith('.'))


def read_text(path: Path, strict: bool = True) -> str:
    """The text of a file: UTF-8, or UTF-16 with a mark at its beginning; every line ends with a line feed.

    Args:
        path: The file.
        strict: False: bytes in another encoding become question marks; for files whose names nobody compares.

    Raises:
        FileNotFoundError: There is no such file.
        SceneError: It is in another encoding.
    """
    data = plain_text(path.read_bytes())
    try:
        return data.decode('utf-8', errors='strict' if strict else 'replace')
    except UnicodeDecodeError as error:
        line = data.count(b'\n', 0, error.start) + 1
        raise SceneError(
            f'{path}, line {line}: byte {data[error.start]:#04x} is no UTF-8; save the file as UTF-8 text'
        ) from error


def read_list(path: Path, words: bool = False) -> list[str]:
    """The names of a list, one a line; blanks around them and empty lines do not count.

    Bytes that are no UTF-8 stay as names of files hold them, so that a list of ``ls`` finds every file.

    Args:
        path: The list.
        words: Names have no blanks, so that several may stand on a line.

    Raises:
        FileNotFoundError: There is no such file.
    """
    text = plain_text(path.read_bytes()).decode('utf-8', errors='surrogateescape')
    lines = text.split() if words else text.split('\n')
    return [line.strip() for line in lines if line.strip()]


def read_number(text: object) -> float:
    """A number as a file means it: Python takes ``1_0`` for ten and True for one.

    Raises:
        ValueError: It is none.
        TypeError: It is neither text nor a number.
    """
    if isinstance(text, bool) or (isinstance(text, str) and '_' in text):
        raise ValueError(f'{text!r} is no number')
    return float(text)  # type: ignore[arg-type]
