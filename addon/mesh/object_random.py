"""Random numbers of objects, equal to the Random output of the Object Info node in Cycles."""

from __future__ import annotations

import bpy

_ALL_BITS = 0xFFFFFFFF


def random_of(instance: bpy.types.DepsgraphObjectInstance) -> float:
    """Return the random number in [0, 1] of an object or instance. That of an object is a hash of its name."""
    number = instance.random_id if instance.is_instance else _hash(_hash_of_text(instance.object.name))
    return (number & _ALL_BITS) / _ALL_BITS


def _hash_of_text(text: str) -> int:
    number = 0
    for byte in text.encode():
        number = (37 * number + byte) & _ALL_BITS
    return number


def _hash(number: int) -> int:
    """Return Bob Jenkins' lookup3 hash of `number` and 0 (public domain, 2006)."""
    a = b = c = (0xDEADBEEF + (2 << 2) + 13) & _ALL_BITS
    a = (a + number) & _ALL_BITS

    def turned(value: int, bits: int) -> int:
        return ((value << bits) | (value >> (32 - bits))) & _ALL_BITS

    c = ((c ^ b) - turned(b, 14)) & _ALL_BITS
    a = ((a ^ c) - turned(c, 11)) & _ALL_BITS
    b = ((b ^ a) - turned(a, 25)) & _ALL_BITS
    c = ((c ^ b) - turned(b, 16)) & _ALL_BITS
    a = ((a ^ c) - turned(c, 4)) & _ALL_BITS
    b = ((b ^ a) - turned(a, 14)) & _ALL_BITS
    return ((c ^ b) - turned(b, 24)) & _ALL_BITS
