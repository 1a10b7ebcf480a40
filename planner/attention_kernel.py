"""The convolutional block attention module (Woo et al. 2018) and its gradient, a sample at a time.

As a dozen tensor operations over maps this small, most of an update's time went into it. Arrays are of one
floating type: features (n, channels, rows, cols); the channels' shared perceptron as w1 (hidden, channels),
b1 (hidden,), w2 (channels, hidden), b2 (channels,); the places' convolution of mean and maximum as kernel
(2, 3, 3) and bias (1,). Of equal maxima the first counts. Loops run along flat maps, those of the convolution
with a rim of zeros, so that each is a few instructions over many places at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def attend(features, w1, b1, w2, b2, kernel, bias):
    """Features after both attentions, and what the gradient needs: pooled (n, 2, channels), hidden
    (n, 2, hidden), place of each channel's maximum and its gate (n, channels), channel of each place's
    maximum and its gate (n, rows · cols), pooled maps with rims (n, 2, (rows + 2) · (cols + 2))."""
    count, channels, rows, cols = features.shape
    places, width = rows * cols, cols + 2
    kind = features.dtype
    flat, out = features.reshape(count, channels, places), np.empty((count, channels, places), kind)
    pooled, hidden = np.empty((count, 2, channels), kind), np.empty((count, 2, len(b1)), kind)
    peak, gate = np.empty((count, channels), np.int64), np.empty((count, channels), kind)
    strongest, place_gate = np.zeros((count, places), np.int32), np.empty((count, places), kind)
    maps = np.zeros((count, 2, (rows + 2) * width), kind)
    mean, most, logit = np.empty(places, kind), np.empty(places, kind), np.empty(rows * width, kind)
    for n in range(count):
        for c in range(channels):
            pooled[n, 0, c], pooled[n, 1, c], peak[n, c] = _pool(flat[n, c], cols)
        _gate_channels(pooled[n], w1, b1, w2, b2, hidden[n], gate[n])
        mean[:] = 0.0
        for c in range(channels):
            weigh = gate[n, c]
            source, target, who = flat[n, c], out[n, c], strongest[n]
            for i in range(places):
                value = source[i] * weigh
                target[i] = value
                mean[i] += value
            if c == 0:
                most[:] = target
            for i in range(places):
                who[i] = c if target[i] > most[i] else who[i]
                most[i] = max(target[i], most[i])
        mean /= channels
        for row in range(rows):
            begin = (row + 1) * width + 1
            maps[n, 0, begin : begin + cols] = mean[row * cols : (row + 1) * cols]
            maps[n, 1, begin : begin + cols] = most[row * cols : (row + 1) * cols]
        logit[:] = bias[0]
        for q in range(2):
            for tap in range(9):
                weigh, shifted = kernel[q, tap // 3, tap % 3], maps[n, q, (tap // 3) * width + tap % 3 :]
                for i in range(rows * width - 2):
                    logit[i] += weigh * shifted[i]
        for row in range(rows):
            for col in range(cols):
                place_gate[n, row * cols + col] = _sigmoid(logit[row * width + col])
        for c in range(channels):
            target, weights = out[n, c], place_gate[n]
            for i in range(places):
                target[i] *= weights[i]
    return out.reshape(features.shape), pooled, hidden, peak, gate, strongest, place_gate, maps


@njit(cache=True, nogil=True)
def in_blocks(features, side):
    """Features (n, channels, rows, cols) as (n, rows / side, cols / side, channels · side²), each block's
    channel by channel and row by row: what a convolution whose blocks do not overlap multiplies by."""
    count, channels, rows, cols = features.shape
    blocks = np.empty((count, rows // side, cols // side, channels, side, side), features.dtype)
    for n in range(count):
        for c in range(channels):
            for row in range(rows // side * side):
                source, down, inner = features[n, c, row], row // side, row % side
                for across in range(cols // side):
                    target, begin = blocks[n, down, across, c, inner], across * side
                    for i in range(side):
                        target[i] = source[begin + i]
    return blocks.reshape((count, rows // side, cols // side, channels * side * side))


@njit(cache=True, nogil=True)
def out_of_blocks(blocks, side):
    """The inverse of `in_blocks`."""
    count, down, across, depth = blocks.shape
    channels = depth // (side * side)
    parts = blocks.reshape((count, down, across, channels, side, side))
    features = np.empty((count, channels, down * side, across * side), blocks.dtype)
    for n in range(count):
        for c in range(channels):
            for row in range(down * side):
                target = features[n, c, row]
                for k in range(across):
                    source, begin = parts[n, row // side, k, c, row % side], k * side
                    for i in range(side):
                        target[begin + i] = source[i]
    return features


@njit(cache=True, nogil=True)
def _sigmoid(value):
    one = value - value + 1
    return one / (one + np.exp(-value))


@njit(cache=True, nogil=True)
def _pool(values, cols):
    """Mean, maximum, and the first place of the maximum."""
    total, most = values[:cols].copy(), values[:cols].copy()
    for begin in range(cols, len(values), cols):
        row = values[begin : begin + cols]
        for i in range(cols):
            total[i] += row[i]
            most[i] = max(most[i], row[i])
    peak, place = most.max(), 0
    while values[place] < peak:
        place += 1
    return total.sum() / len(values), peak, place


@njit(cache=True, nogil=True)
def _gate_channels(pooled, w1, b1, w2, b2, hidden, gate):
    for branch in range(2):
        for h in range(len(b1)):
            value = b1[h]
            for c in range(len(b2)):
                value += w1[h, c] * pooled[branch, c]
            hidden[branch, h] = max(value, value - value)
    for c in range(len(b2)):
        logit = b2[c] + b2[c]
        for h in range(len(b1)):
            logit += w2[c, h] * (hidden[0, h] + hidden[1, h])
        gate[c] = _sigmoid(logit)


@njit(cache=True, nogil=True)
def attend_gradient(slope, features, w1, w2, kernel, pooled, hidden, peak, gate, strongest, place_gate, maps):
    """From the loss's slope by the output, those by features, w1, b1, w2, b2, kernel and bias."""
    count, channels, rows, cols = features.shape
    places, width = rows * cols, cols + 2
    kind = features.dtype
    slopes, flat = slope.reshape(count, channels, places), features.reshape(count, channels, places)
    by_features = np.empty((count, channels, places), kind)
    by_w1, by_b1 = np.zeros(w1.shape, kind), np.zeros(len(w1), kind)
    by_w2, by_b2 = np.zeros(w2.shape, kind), np.zeros(channels, kind)
    by_gate, by_pooled = np.empty(channels, kind), np.empty((2, channels), kind)
    by_logit, rimmed = np.empty(places, kind), np.zeros((rows + 2) * width, kind)
    by_map, by_mean, by_most = np.empty(rows * width, kind), np.empty(places, kind), np.empty(places, kind)
    by_taps, by_bias = np.zeros((18, rows * width), kind), np.zeros(places, kind)
    for n in range(count):
        _logit_gradient(slopes[n], flat[n], gate[n], place_gate[n], by_logit)
        by_bias += by_logit
        for row in range(rows):
            begin = (row + 1) * width + 1
            rimmed[begin : begin + cols] = by_logit[row * cols : (row + 1) * cols]
        for q in range(2):
            by_map[:] = 0.0
            inner = rimmed[width + 1 :]
            for tap in range(9):
                weigh, back = kernel[q, tap // 3, tap % 3], rimmed[(2 - tap // 3) * width + 2 - tap % 3 :]
                shifted, sums = maps[n, q, (tap // 3) * width + tap % 3 :], by_taps[9 * q + tap]
                for i in range(rows * width - 2):
                    by_map[i] += weigh * back[i]
                    sums[i] += inner[i] * shifted[i]
            by_pool = by_mean if q == 0 else by_most
            for row in range(rows):
                by_pool[row * cols : (row + 1) * cols] = by_map[row * width : row * width + cols]
        by_mean /= channels
        for c in range(channels):
            source, given, target = flat[n, c], slopes[n, c], by_features[n, c]
            weights, who, weigh = place_gate[n], strongest[n], gate[n, c]
            for i in range(places):
                gated = given[i] * weights[i] + by_mean[i] + (by_most[i] if who[i] == c else by_most[i] * 0)
                by_logit[i] = gated * source[i]
                target[i] = gated * weigh
            by_gate[c] = _lanes(by_logit, cols) * weigh * (1 - weigh)
        _perceptron_gradient(by_gate, pooled[n], hidden[n], w1, w2, by_w1, by_b1, by_w2, by_b2, by_pooled)
        for c in range(channels):
            by_features[n, c] += by_pooled[0, c] / places
            by_features[n, c, peak[n, c]] += by_pooled[1, c]
    by_kernel, total = np.empty(18, kind), np.empty(1, kind)
    for tap in range(18):
        by_kernel[tap] = by_taps[tap].sum()
    total[0] = by_bias.sum()
    return (
        by_features.reshape(features.shape), by_w1, by_b1, by_w2, by_b2, by_kernel.reshape((2, 3, 3)), total
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _lanes(values, cols):
    """Sum, first of every cols-th."""
    total = values[:cols].copy()
    for begin in range(cols, len(values), cols):
        row = values[begin : begin + cols]
        for i in range(cols):
            total[i] += row[i]
    return total.sum()


@njit(cache=True, nogil=True)
def _logit_gradient(slope, features, gate, place_gate, by_logit):
    by_logit[:] = 0.0
    for c in range(len(gate)):
        given, source, weigh = slope[c], features[c], gate[c]
        for i in range(len(by_logit)):
            by_logit[i] += given[i] * source[i] * weigh
    for i in range(len(by_logit)):
        by_logit[i] *= place_gate[i] * (1 - place_gate[i])


@njit(cache=True, nogil=True)
def _perceptron_gradient(by_gate, pooled, hidden, w1, w2, by_w1, by_b1, by_w2, by_b2, by_pooled):
    """Add the slopes by the perceptron's numbers; fill those by the pooled channels."""
    by_pooled[:] = 0.0
    for c in range(len(by_gate)):
        by_b2[c] += by_gate[c] + by_gate[c]
    for h in range(len(by_b1)):
        back = by_gate[0] - by_gate[0]
        for c in range(len(by_gate)):
            by_w2[c, h] += by_gate[c] * (hidden[0, h] + hidden[1, h])
            back += w2[c, h] * by_gate[c]
        for branch in range(2):
            if hidden[branch, h] > 0.0:
                by_b1[h] += back
                for c in range(len(by_gate)):
                    by_w1[h, c] += back * pooled[branch, c]
                    by_pooled[branch, c] += back * w1[h, c]
