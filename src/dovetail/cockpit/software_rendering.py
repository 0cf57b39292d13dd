"""Less to draw for a browser without a GPU, so that it keeps up.

It renders in software: the time of a picture grows with its triangles and its pixels,
and the mouse waits until it is drawn.
"""

from typing import Any

import numpy as np

from dovetail.types import Array

_SHARE, _FEW = 0.14, 200
"""Of a mesh's triangles these are drawn; a mesh of so many is drawn whole."""
_SLACK = 0.028
"""Largest shift of a bounding box side, over half its longest side [1]."""

ENTRY_PAGE = """<!doctype html><title>dovetail</title><script>
  const gl = document.createElement('canvas').getContext('webgl2');
  const names = gl?.getExtension('WEBGL_debug_renderer_info');
  const name = names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : '';
  const isSoftware = /SwiftShader|llvmpipe|softpipe|Basic Render/i.test(name);
  location.replace(isSoftware ? `?fixedDpr=${0.5 * devicePixelRatio}` : '?gpu');
</script>"""
"""HTML that goes on to viser's page, with its option `fixedDpr` in a browser that
renders in software: half the pixels each way."""

# viser draws as many pictures as it can, and then the mouse stands in a queue.
FRAME_LIMIT = """<img alt="" src="data:," style="display: none" onerror="
(() => {
  if (window.hasFrameLimit || !location.search.includes('fixedDpr')) return;
  window.hasFrameLimit = true;
  const ask = window.requestAnimationFrame.bind(window);
  const cancel = window.cancelAnimationFrame.bind(window);
  const again = new Map();
  let last = 0;
  window.requestAnimationFrame = (draw) => {
    const id = ask(function wait(now) {
      again.delete(id);
      if (now > last && now - last < 25) { again.set(id, ask(wait)); return; }
      last = now;
      draw(now);
    });
    return id;
  };
  window.cancelAnimationFrame = (id) => {
    cancel(again.get(id) ?? id);
    again.delete(id);
  };
})()">"""
"""HTML for a panel: the same browser draws every other picture of 60 a second."""


def fewer_triangles(vertices: Array, faces: Array) -> tuple[Array, Array]:
    """Return nearly the same surface with fewer triangles.

    Quadric error metrics (Garland and Heckbert 1997).

    Args:
        vertices: [m], shape (vertices, 3).
        faces: Numbers of each triangle's vertices, shape (faces, 3).
    """
    from fast_simplification import simplify

    count = max(_FEW, int(_SHARE * len(faces)))
    while count < len(faces):
        found: Any = simplify(vertices, np.asarray(faces, np.int32), target_count=count)
        fewer = np.asarray(found[0], dtype=float)
        if _is_as_large(fewer, vertices):
            return fewer, np.asarray(found[1])
        count += count // 4
    return vertices, faces


def _is_as_large(fewer: Array, vertices: Array) -> bool:
    """Return whether its bounding box has stayed: quadrics may pull a tip out."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    moved = np.abs([fewer.min(axis=0) - low, fewer.max(axis=0) - high])
    return bool(moved.max() <= _SLACK * (high - low).max() / 2.0)
