"""Decode text files as programs of all systems write them."""

from __future__ import annotations

import json

from sshade.errors import InputError


def decoded(content: bytes) -> str:
    """Decode UTF-8, UTF-16 or UTF-32, with or without a byte-order mark, which is dropped.

    Raises
    ------
    InputError
        When the bytes are text in none of these encodings.
    """
    try:
        return content.decode(json.detect_encoding(content))
    except UnicodeDecodeError as error:
        raise InputError("it is neither UTF-8 nor UTF-16 text; save it as UTF-8") from error
