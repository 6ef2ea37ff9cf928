"""A name for what a part computes, so that caches tell apart what other settings or other weights made."""

from typing import ClassVar, final

from rm3d_plugin.storage.files import content_key


class Fingerprinted:
    """Base of parts whose results are kept on disk.

    The public attributes of such a part are its settings, and its weights where it has some (arrays by name); whatever
    it derives from them it keeps under a name with an underscore.

    Attributes:
        version: Of the code; raise it when the same settings give other results than before.
    """

    version: ClassVar[int] = 1

    @final
    def fingerprint(self) -> str:
        """Names kind, version, settings and weights: equal parts have equal names, on every machine.

        Returns:
            32 hexadecimal digits.

        Raises:
            TypeError: A public attribute has no stable content, such as a function or a network.
        """
        parts = {
            name: value.fingerprint() if isinstance(value, Fingerprinted) else value
            for name, value in vars(self).items()
            if not name.startswith('_')
        }
        kind = f'{type(self).__module__}.{type(self).__qualname__}'
        try:
            return content_key(kind, self.version, parts)
        except TypeError as error:
            raise TypeError(
                f'{kind}.fingerprint: {error}; keep weights as arrays by name, and other parts under a name with an '
                'underscore'
            ) from error
