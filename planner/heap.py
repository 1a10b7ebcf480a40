"""A binary heap of (key, item) pairs in plain arrays, for searches in compiled code."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def push(keys, items, size, key, item):
    """Put an item on the heap, ordered by key, then item; the arrays grow by doubling."""
    if size == len(keys):
        keys = np.concatenate((keys, np.empty(size)))
        items = np.concatenate((items, np.empty(size, np.int64)))
    at = size
    while at > 0:
        above = (at - 1) // 2
        if not (key < keys[above] or (key == keys[above] and item < items[above])):
            break
        keys[at], items[at] = keys[above], items[above]
        at = above
    keys[at], items[at] = key, item
    return keys, items, size + 1


@njit(cache=True)
def pop(keys, items, size):
    """Take the least item off the heap: the item and the heap's new size."""
    least = items[0]
    size -= 1
    key, item = keys[size], items[size]
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size:
            break
        right = child + 1
        if right < size and (
            keys[right] < keys[child] or (keys[right] == keys[child] and items[right] < items[child])
        ):
            child = right
        if not (keys[child] < key or (keys[child] == key and items[child] < item)):
            break
        keys[at], items[at] = keys[child], items[child]
        at = child
    keys[at], items[at] = key, item
    return least, size
