"""Layouts as plane trees with marks: a node in every closing vertex, an edge through every cell.

Walk round the tree, the tree on the left: a tree of k cells has 2k corners, and every step from one
corner to the next goes along one side of a cell, past its opening vertex there. A corner is *marked*
where the outline passes. So the unmarked corners are the inner edges of the layout, the runs of steps
between marked corners its opening vertices. A node on the outline has one marked corner; an inner node
has none, and three corners or more.

The *word* of a tree holds a byte per corner: twice the degree of its node, plus one if marked. It tells
the tree but for where the walk starts, and its reversal tells the mirror image.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from ori_deploy.errors import LayoutError
from ori_deploy.layout.layout import Layout, Vertex, outline_successors

LEAF = 3
"""The letter of a leaf: degree 1, marked. The smallest letter there is."""
MAX_CELLS = 126
"""Letters have to fit into a byte."""

_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz"

Cells = tuple[tuple[int, int, int, int], ...]


@dataclass(frozen=True)
class Symmetry:
    """A rotation or reflection that maps a layout to itself.

    Attributes
    ----------
    mirrored
        Whether it is a reflection.
    images
        (n_vertices,) index of the vertex that each vertex goes to.
    """

    mirrored: bool
    images: tuple[int, ...]


@dataclass(frozen=True)
class PlaneTree:
    """A layout without slits, as the word of its plane tree.

    Make one with `layouts`, `PlaneTree.from_code` or `PlaneTree.of`, which check it. Two trees are equal
    if their words are: compare `canonical()` forms to tell layouts apart.
    """

    word: bytes

    @classmethod
    def from_code(cls, code: str) -> PlaneTree:
        """The tree of a code as `code` writes it.

        Raises
        ------
        LayoutError
            Not a code, or not that of an allowable layout.
        """
        tree = cls(_parse(code))
        wrong = _fault(tree.word)
        if wrong:
            raise LayoutError(
                f"layout code {code}: {wrong}",
                limit="degrees of the closing vertices along the outline walk, * where the outline passes",
                remedy="copy a code that ori-deploy layouts prints",
            )
        return tree

    @classmethod
    def of(cls, layout: Layout) -> tuple[PlaneTree, tuple[int, ...]]:
        """The tree of a layout, and the layout's vertex index of each of the tree's vertices.

        Raises
        ------
        LayoutError
            An opening vertex inside: the layout is no plane tree. Or over 126 cells.
        """
        inside = next((v.id for v in layout.vertices if v.inner and v.role == "opening"), None)
        if inside is not None:
            raise LayoutError(
                f"layout: opening vertex {inside} is inside",
                limit="plane trees have every opening vertex on the outline",
                remedy="swap closing and opening, or move the vertex to the outline",
            )
        check_size(layout.n_cells)
        corners = _walk(layout.cells)
        degree: dict[int, int] = {}
        for node, _ in corners:
            degree[node] = degree.get(node, 0) + 1
        tree = cls(bytes(2 * degree[node] + (past is None) for node, past in corners))
        return tree, tree._places(corners, layout)

    def _places(self, corners: list[tuple[int, int | None]], layout: Layout) -> tuple[int, ...]:
        follow = outline_successors(layout.cells)
        place = [-1] * len(self.vertices)
        for i, (node, _) in enumerate(corners):
            place[self._node_index[self._nodes[i]]] = node
            if self.word[i] & 1:
                place[self._opening_index[i]] = follow[node]
        return tuple(place)

    @property
    def n_cells(self) -> int:
        return len(self.word) // 2

    @cached_property
    def n_inner(self) -> int:
        """Number of inner vertices: every tree has a node more than cells, every other node has one mark."""
        return self.n_cells + 1 - sum(letter & 1 for letter in self.word)

    @cached_property
    def code(self) -> str:
        """The word for people: the degree at each corner, base 36, with a star where the outline passes.

        A leaf's star is left out. "11" is one cell, "14141414" four cells round an inner vertex.
        """
        return "".join(
            (_DIGITS[x >> 1] if x >> 1 < len(_DIGITS) else f"({x >> 1})") + ("*" if x & 1 and x != LEAF else "")
            for x in self.word
        )

    def canonical(self, *, mirror_apart: bool = False) -> PlaneTree:
        """The same tree as `layouts` gives it: the greatest of the words that start at a leaf.

        Parameters
        ----------
        mirror_apart
            Whether mirror images are told apart; if not, both give the same tree.
        """
        words = _leaf_words(self.word)
        return PlaneTree(max(words) if mirror_apart else max(*words, *_leaf_words(self.word[::-1])))

    def mirrored(self) -> PlaneTree:
        """The mirror image."""
        return PlaneTree(self.word[:1] + self.word[:0:-1])

    @cached_property
    def _nodes(self) -> tuple[int, ...]:
        """(2k,) the node at each corner, numbered in order of appearance."""
        nodes, left, path = [0], [self.word[0] >> 1], [0]
        for letter in self.word[1:]:
            left[path[-1]] -= 1
            if left[path[-1]] < 0 or (left[path[-1]] == 0 and path[-1]):
                path.pop()
            else:
                path.append(len(left))
                left.append(letter >> 1)
            nodes.append(path[-1])
        return tuple(nodes)

    @cached_property
    def _twin(self) -> tuple[int, ...]:
        """(2k,) the step along the other side of the cell that each step goes along."""
        n = self._nodes
        at = {(n[i - 1], n[i]): (i - 1) % len(n) for i in range(len(n))}
        return tuple(at[n[(i + 1) % len(n)], n[i]] for i in range(len(n)))

    @cached_property
    def _node_index(self) -> dict[int, int]:
        """Vertex index of each node: inner ones first, then those on the outline counter-clockwise."""
        on_outline = [node for node, letter in zip(self._nodes, self.word, strict=True) if letter & 1]
        known = set(on_outline)
        inner = [node for node in dict.fromkeys(self._nodes) if node not in known]
        return {node: i for i, node in enumerate((*inner, *on_outline))}

    @cached_property
    def _opening_index(self) -> tuple[int, ...]:
        """(2k,) vertex index of the opening vertex that the step after each corner goes past."""
        n_closing = self.n_cells + 1
        n_opening = n_closing - self.n_inner
        run, found = (0 if self.word[0] & 1 else n_opening) - 1, []
        for letter in self.word:
            run += letter & 1
            found.append(n_closing + run % n_opening)
        return tuple(found)

    @cached_property
    def vertices(self) -> tuple[Vertex, ...]:
        """Inner closing vertices P1…, closing ones on the outline C1…, opening ones O1….

        C and O are numbered counter-clockwise from the start of the word; O1 comes next after C1.
        """
        n_outline = self.n_cells + 1 - self.n_inner
        return (
            *(Vertex(f"P{i + 1}", "closing", True) for i in range(self.n_inner)),
            *(Vertex(f"C{i + 1}", "closing", False) for i in range(n_outline)),
            *(Vertex(f"O{i + 1}", "opening", False) for i in range(n_outline)),
        )

    @cached_property
    def cells(self) -> Cells:
        """Vertex indices per cell: closing, opening, closing, opening, counter-clockwise."""
        n, node, past, twin = len(self.word), self._node_index, self._opening_index, self._twin
        closing = [node[v] for v in self._nodes]
        return tuple((closing[i], past[i], closing[(i + 1) % n], past[twin[i]]) for i in range(n) if i < twin[i])

    @cached_property
    def cell_names(self) -> tuple[tuple[str, str, str, str], ...]:
        """`cells` by vertex ids, as `make_layout` takes them."""
        ids = [v.id for v in self.vertices]
        return tuple((ids[a], ids[c], ids[b], ids[d]) for a, c, b, d in self.cells)

    def symmetries(self, *, mirror_apart: bool = False) -> tuple[Symmetry, ...]:
        """The group of rotations, and, unless mirror images are told apart, reflections. The identity comes first."""
        n, word = len(self.word), self.word
        found = [self._symmetry(0, 1, turn) for turn in occurrences(word, word)]
        if not mirror_apart:
            # The reversed word at `turn`: corner i lies on corner turn + n - 1 - i.
            found += [self._symmetry(1, -1, turn + n - 1) for turn in occurrences(word, word[::-1])]
        return tuple(found)

    def _symmetry(self, mirrored: int, sense: int, shift: int) -> Symmetry:
        """Corner i goes to corner `shift + sense * i`; a step backwards starts where it ended."""
        n = len(self.word)
        images = [-1] * len(self.vertices)
        for i in range(n):
            to = shift + sense * i
            images[self._node_index[self._nodes[i]]] = self._node_index[self._nodes[to % n]]
            images[self._opening_index[i]] = self._opening_index[(to - mirrored) % n]
        return Symmetry(bool(mirrored), tuple(images))

    @cached_property
    def inner_edges(self) -> tuple[tuple[int, int], ...]:
        """(closing, opening) vertex indices of the edges between two cells, along the walk."""
        return tuple(
            (self._node_index[self._nodes[i]], self._opening_index[i])
            for i, letter in enumerate(self.word)
            if not letter & 1
        )


def check_size(n_cells: int) -> None:
    """Refuse what words of bytes cannot hold.

    Raises
    ------
    LayoutError
        Over 126 cells.
    """
    if n_cells > MAX_CELLS:
        raise LayoutError(
            "layout: too many cells for a plane tree", value=n_cells, limit=f"{MAX_CELLS}", remedy="use fewer cells"
        )


def occurrences(word: bytes, wanted: bytes) -> Iterator[int]:
    """Where in the cyclic `word` `wanted`, of the same length, is read."""
    twice = (word + word)[:-1]
    at = twice.find(wanted)
    while at >= 0:
        yield at
        at = twice.find(wanted, at + 1)


def _leaf_words(word: bytes) -> list[bytes]:
    return [word[i:] + word[:i] for i, letter in enumerate(word) if letter == LEAF]


def _walk(cells: Sequence[tuple[int, int, int, int]]) -> list[tuple[int, int | None]]:
    """Round the tree of a layout: the node at each corner, and the opening vertex of its inner edge or None."""
    after: dict[tuple[int, int], tuple[int, int]] = {}
    for a, c, b, d in cells:
        after[a, c] = (b, c)
        after[b, d] = (a, d)
    follow = outline_successors(cells)
    start = next((v, after_v) for v, after_v in sorted(follow.items()) if (v, after_v) in after)
    edge, corners = start, list[tuple[int, int | None]]()
    while True:
        node, past = edge
        corners.append((node, None if follow.get(node) == past else past))
        arrived, past = after[edge]
        edge = (arrived, past) if (arrived, past) in after else (arrived, follow[arrived])
        if edge == start:
            return corners


def _parse(code: str) -> bytes:
    letters: list[int] = []
    rest = code
    while rest:
        if rest[0] == "(":
            digits, _, rest = rest[1:].partition(")")
            degree = int(digits) if digits.isascii() and digits.isdecimal() and len(digits) < 4 else 0
        else:
            degree, rest = max(_DIGITS.find(rest[0]), 0), rest[1:]
        starred = rest.startswith("*")
        rest = rest[1:] if starred else rest
        if not 0 < degree <= MAX_CELLS:
            raise LayoutError(
                f"layout code {code[:80]}: not a code",
                value=f"character {len(code) - len(rest)}",
                limit="digits and letters for degrees from 1, (36) and so on beyond z, stars",
                remedy="copy a code that ori-deploy layouts prints",
            )
        letters.append(2 * degree + (starred or degree == 1))
    check_size(len(letters) // 2)
    return bytes(letters)


def _fault(word: bytes) -> str | None:
    """Why a word is not that of an allowable layout."""
    if not word or len(word) % 2:
        return f"{len(word)} corners, not an even number above 0"
    left = [word[0] >> 1]
    degree, marks, path = [word[0] >> 1], [word[0] & 1], [0]
    for i, letter in enumerate(word[1:], 2):
        here = path[-1]
        left[here] -= 1
        if left[here] < 0 or (left[here] == 0 and here):
            path.pop()
            if not path or degree[path[-1]] != letter >> 1 or left[path[-1]] == 0:
                return f"the degree at corner {i} does not fit"
        else:
            path.append(len(left))
            left.append(letter >> 1)
            degree.append(letter >> 1)
            marks.append(0)
        marks[path[-1]] += letter & 1
    if len(left) != len(word) // 2 + 1 or len(path) != 2 or left[path[1]] != 1 or left[0] != 0:
        return "the walk does not close"
    for d, m in zip(degree, marks, strict=True):
        if m > 1:
            return f"the outline passes a closing vertex of degree {d} {m} times"
        if not m and d < 3:
            return f"an inner vertex of degree {d}, below 3"
    return None
