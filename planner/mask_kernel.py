"""One pass over a camera's instance mask: what each object in it measures, and which pixels stand for it."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def masks(body, depth, wanted, min_pixels, samples):
    """Measure every wanted instance of at least `min_pixels` pixels, by ascending label.

    body, depth : (height, width) int32 labels, -1 for none, and float32 metres; wanted : (labels,) bool
    samples : pixels that stand for a mask at most: every n-th of them, row by row

    Returns, for each of m masks, boxes (m, 5) int64 of label, x_min, x_max, y_min, y_max; counts (m,) of its
    pixels; median depths (m,) float64 of its samples; hidden (m,) the share of its box, thinned to some
    twenty rows and columns, where something else is more than half a metre nearer than that; the samples'
    pixels, as indices into the flattened image, mask after mask, with where each mask's begin (m + 1,); and
    the last five pixels (m, 5) of each.
    """
    height, width = body.shape
    count = np.zeros(len(wanted), np.int64)
    box = np.empty((len(wanted), 4), np.int64)
    for row in range(height):
        for col in range(width):
            label = body[row, col]
            if label < 0 or not wanted[label]:
                continue
            if count[label] == 0:
                box[label] = col, col, row, row
            count[label] += 1
            box[label, 0], box[label, 1] = min(box[label, 0], col), max(box[label, 1], col)
            box[label, 3] = row
    chosen = np.flatnonzero(count >= min_pixels)
    place = np.full(len(wanted), -1)
    stride, begins = np.empty(len(chosen), np.int64), np.zeros(len(chosen) + 1, np.int64)
    for m in range(len(chosen)):
        place[chosen[m]] = m
        stride[m] = -(-count[chosen[m]] // samples)
        begins[m + 1] = begins[m] - (-count[chosen[m]] // stride[m])
    pixels, lowest = np.empty(begins[-1], np.int64), np.empty((len(chosen), 5), np.int64)
    passed = np.zeros(len(chosen), np.int64)
    for row in range(height):
        for col in range(width):
            label = body[row, col]
            if label < 0 or place[label] < 0:
                continue
            m, pixel = place[label], row * width + col
            if passed[m] % stride[m] == 0:
                pixels[begins[m] + passed[m] // stride[m]] = pixel
            last = passed[m] - count[label] + 5
            if last >= 0:
                lowest[m, last] = pixel
            passed[m] += 1
    boxes, middle, hidden = np.empty((len(chosen), 5), np.int64), np.empty(len(chosen)), np.empty(len(chosen))
    flat = depth.ravel()
    for m in range(len(chosen)):
        boxes[m, 0], boxes[m, 1:] = chosen[m], box[chosen[m]]
        middle[m] = median(flat[pixels[begins[m] : begins[m + 1]]])
        hidden[m] = _hidden(body, depth, boxes[m], np.float32(middle[m] - 0.5))
    return boxes, count[chosen], middle, hidden, pixels, begins, lowest


@njit(cache=True)
def median(values):
    """As `numpy.median`, in the values' own precision; they are put in order."""
    values.sort()
    half = len(values) // 2
    if len(values) % 2:
        return values[half]
    return (values[half - 1] + values[half]) / values.dtype.type(2)


@njit(cache=True)
def _hidden(body, depth, box, limit):
    label, x_min, x_max, y_min, y_max = box
    before = looked = 0
    for row in range(y_min, y_max + 1, max((y_max - y_min) // 20, 1)):
        for col in range(x_min, x_max + 1, max((x_max - x_min) // 20, 1)):
            looked += 1
            before += body[row, col] != label and depth[row, col] < limit
    return before / looked


@njit(cache=True)
def medians(values, begins):
    """(m, columns) the median of each column of `values` (n, columns) from begins[k] to begins[k + 1]."""
    middle = np.empty((len(begins) - 1, values.shape[1]))
    for k in range(len(middle)):
        for c in range(values.shape[1]):
            middle[k, c] = median(values[begins[k] : begins[k + 1], c].copy())
    return middle
