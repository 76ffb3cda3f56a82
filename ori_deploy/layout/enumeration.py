"""Every layout of so many cells, each once: canonical augmentation on plane trees.

Method: B. D. McKay, Isomorph-free exhaustive generation, J. Algorithms 26 (1998). A tree of k cells
grows by a leaf at one of its corners. The child is kept if no leaf of it reads greater than the new one,
where a leaf reads as the tree's word from there on (the greater of both directions where mirror images
count once); of corners that a symmetry of the parent exchanges only one is tried. So every layout comes
from one parent, once, and nothing is remembered but the path from the single cell down to here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from ori_deploy.errors import LayoutError
from ori_deploy.layout.layout import AllowableRule, opening_vertices_on_outline
from ori_deploy.layout.plane_tree import LEAF, PlaneTree, check_size
from ori_deploy.layout.slit_choices import folds_flat_with_some_slits

_MARKED = 128
"""Added to a node's number where the outline passes."""
_KINDS = ((_MARKED, 0), (0, _MARKED), (0, 0))
"""Marks of the two corners beside a leaf that grows from a marked corner; from an unmarked one only the last."""


def layouts(
    n_cells: int,
    *,
    inner: int | None = None,
    mirror_apart: bool = False,
    allowable: AllowableRule = opening_vertices_on_outline,
) -> Iterator[PlaneTree]:
    """All allowable layouts of `n_cells` cells, up to rotation, in the order they are found.

    Parameters
    ----------
    n_cells
        Up to 126, though their number grows about sixfold with every cell: 154 of 6 cells, 21,611 of 9.
    inner
        Only those with this many inner vertices.
    mirror_apart
        Count the two mirror images of a layout apart instead of once.
    allowable
        Rule that says which layouts fold flat. All that have their opening vertices on the outline are
        generated and put to it, so another rule can refuse more of them, not fewer.

    Yields
    ------
    PlaneTree
        In canonical form.

    Raises
    ------
    LayoutError
        Fewer than 1 cell or over 126, or fewer than 0 inner vertices: when called, not when first iterated.
    """
    _check(n_cells, inner)
    hopeful: list[_Hope] = [] if inner is None else [lambda word, missing: _can_have_inner(word, missing, inner)]
    if allowable is folds_flat_with_some_slits:
        hopeful.append(_can_fold_flat)
    words = _words(n_cells, mirror_apart, hopeful) if inner is None or inner <= most_inner(n_cells) else iter(())
    if allowable is opening_vertices_on_outline:
        return map(PlaneTree, words)
    trees = map(PlaneTree, words)
    return (tree for tree in trees if allowable(tree.vertices, tree.cells) is None)


def count_by_inner(
    n_cells: int,
    *,
    inner: int | None = None,
    mirror_apart: bool = False,
    allowable: AllowableRule = opening_vertices_on_outline,
) -> dict[int, int]:
    """Number of layouts for every number of inner vertices, from 0 to the largest that occurs.

    Parameters
    ----------
    n_cells, inner, mirror_apart, allowable
        As in `layouts`. With `inner`, only that number is counted: 0 where there are none.

    Raises
    ------
    LayoutError
        As `layouts`.
    """
    found: dict[int, int] = {}
    for tree in layouts(n_cells, inner=inner, mirror_apart=mirror_apart, allowable=allowable):
        n = tree.n_inner
        found[n] = found.get(n, 0) + 1
    return {n: found.get(n, 0) for n in ([inner] if inner is not None else range(max(found, default=0) + 1))}


def most_inner(n_cells: int) -> int:
    """The largest number of inner vertices: each has degree 3 or more, so leaves outnumber them by 2."""
    return max(n_cells - 1, 0) // 2


def _check(n_cells: int, inner: int | None) -> None:
    if n_cells < 1:
        raise LayoutError("layouts: too few cells", value=n_cells, limit="at least 1", remedy="ask for 1 or more")
    check_size(n_cells)
    if inner is not None and inner < 0:
        raise LayoutError(
            "layouts: number of inner vertices", value=inner, limit="at least 0", remedy="ask for 0 or more"
        )


_Hope = Callable[[bytes, int], bool]
"""Whether some tree that grows from a word by so many leaves can be one of those asked for."""


def _words(n_cells: int, mirror_apart: bool, hopeful: Sequence[_Hope]) -> Iterator[bytes]:
    """Canonical words, each once."""
    letters = bytearray(256)
    letters[0] = letters[1] = 2
    letters[_MARKED] = letters[_MARKED + 1] = LEAF
    return _descendants(bytes([_MARKED, _MARKED + 1]), letters, n_cells - 1, mirror_apart, hopeful)


def _descendants(
    contour: bytes, letters: bytearray, missing: int, mirror_apart: bool, hopeful: Sequence[_Hope]
) -> Iterator[bytes]:
    """Words of the trees with `missing` cells more that come from this one.

    Parameters
    ----------
    contour
        The node at each corner, plus 128 if marked.
    letters
        (256,) the letter of each such byte. Changed while a child is looked at, and changed back.
    """
    word = contour.translate(letters)
    if not missing:
        yield word
        return
    new = len(contour) // 2 + 1
    letters[new], letters[new | _MARKED] = 2, LEAF
    for corner, before, after in _sites(word, mirror_apart):
        node = contour[corner] & ~_MARKED
        if node | _MARKED not in contour:
            continue  # inner: a leaf less and it would lie on the outline, so it grows from there alone
        letters[node] += 2
        letters[node | _MARKED] += 2
        grown = (
            bytes((new | _MARKED, node | after)) + contour[corner + 1 :] + contour[:corner] + bytes((node | before,))
        )
        child = grown.translate(letters)
        sense = _sense(child, mirror_apart)
        if sense and all(hope(child, missing - 1) for hope in hopeful):
            turned = grown if sense > 0 else grown[:1] + grown[:0:-1]
            yield from _descendants(turned, letters, missing - 1, mirror_apart, hopeful)
        letters[node] -= 2
        letters[node | _MARKED] -= 2


def _sites(word: bytes, mirror_apart: bool) -> Iterator[tuple[int, int, int]]:
    """Corners where a leaf may grow and be the canonical one, with the marks before and after it.

    One of each orbit of the parent's symmetries; without those that another leaf surpasses at once
    because its neighbour's letter is greater.
    """
    n = len(word)
    nexts = sorted(
        (word[i + 1 - n] if mirror_apart else max(word[i - 1], word[i + 1 - n]), i)
        for i in range(n)
        if word[i] == LEAF
    )
    (runner_up, _), (best, champion) = nexts[-2:]
    turn = (word + word).find(word, 1)
    flip = -1 if mirror_apart else (word + word).find(word[::-1])
    for i in range(turn):
        letter = word[i]
        # A leaf that grows is a leaf no more; no other letter beside a leaf gets smaller.
        to_beat = (runner_up if i == champion else best) - 2 * (letter >> 1) - 2
        if to_beat > 1:
            continue
        opposite = (flip - 1 - i) % turn if flip >= 0 else turn
        if opposite < i:
            continue
        for before, after in _KINDS if letter & 1 else _KINDS[2:]:
            marked = after if mirror_apart else before | after
            if (marked > 0) < to_beat or (letter == LEAF and not before | after):
                continue
            if opposite == i and after > before:
                continue
            yield i, before, after


def _sense(word: bytes, mirror_apart: bool) -> int:
    """Whether the leaf at the start reads greatest of all: 1 forwards, -1 backwards, 0 if another surpasses it."""
    n = len(word)
    ahead = word + word
    if mirror_apart:
        at = word.find(LEAF, 1)
        while at > 0:
            if ahead[at : at + n] > word:
                return 0
            at = word.find(LEAF, at + 1)
        return 1
    back = ahead[::-1]
    backwards = back[n - 1 : 2 * n - 1]
    code = max(word, backwards)
    at = word.find(LEAF, 1)
    while at > 0:
        if ahead[at : at + n] > code or back[n - 1 - at : 2 * n - 1 - at] > code:
            return 0
        at = word.find(LEAF, at + 1)
    return 1 if code is word else -1


def _can_have_inner(word: bytes, missing: int, inner: int) -> bool:
    """Whether `missing` more leaves can bring the number of inner vertices to `inner`.

    It never falls. A leaf that turns a node inner uses up a marked node of degree 2 or more; where
    these run out another leaf has to make one first.
    """
    n_marks = sum(letter & 1 for letter in word)
    lacking = inner - (len(word) // 2 + 1 - n_marks)
    ready = n_marks - word.count(LEAF)
    return lacking >= 0 and lacking + max(0, lacking - ready) <= missing


def _can_fold_flat(word: bytes, missing: int) -> bool:
    """Whether slits may be enough to part all rows of three cells, or more, at opening vertices.

    Of two neighbouring corners without a mark one has to be a slit, so in a run of n at least n // 2,
    and no leaf ever comes between them. There is one slit per inner vertex, and every missing leaf can
    turn one node inner. The word starts at a leaf, so no run goes round its end.
    """
    marks = bytes(letter & 1 for letter in word)
    slits = sum(len(run) // 2 for run in marks.split(b"\1"))
    return slits <= len(word) // 2 + 1 - sum(marks) + missing
