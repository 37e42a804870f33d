"""What is changed of viser's own page, which has no options for it: served and saved alike."""

from __future__ import annotations

import gzip

NARROW = 576
"""Pixels of a window below which viser puts its panel over the scene, at the bottom."""
_BAR = '[style*="cursor: pointer"][style*="height: 3.5em"]'
"""The bar of that panel, which folds and unfolds it."""
_HEAD = f"""<style>
@media (max-width: {NARROW}px) {{
  [style*="min-height: 3.5em"], div:has(> {_BAR}) {{ width: 100vw !important }}
  {_BAR}::after {{ content: "controls \\25B4\\25BE"; margin-left: auto; color: #666 }}
}}
</style>
<script>
// Before anything else is seen, the page would tell that there is no graphics card: it asks so.
for (const kind of [window.WebGLRenderingContext, window.WebGL2RenderingContext]) {{
  if (!kind) continue;
  const get = kind.prototype.getExtension;
  kind.prototype.getExtension = function (name) {{
    return name === "WEBGL_debug_renderer_info" ? null : get.call(this, name);
  }};
}}
// On a phone the panel would hide the scene: it is folded until its bar is touched.
if (innerWidth < {NARROW}) new MutationObserver((_, observer) => {{
  const bar = document.querySelector('{_BAR}');
  if (bar) {{ observer.disconnect(); setTimeout(() => bar.click()); }}
}}).observe(document, {{ childList: true, subtree: true }});
</script>
"""


def amended(page: str, head: str = "") -> str:
    """Return viser's page under this library's name, folded on phones; ``head`` is added to it."""
    page = page.replace("<title>Viser</title>", "<title>noslip</title>", 1)
    # Before the page's own script, which holds closing tags as text too.
    start, tag, rest = page.partition("<head>")
    return f"{start}{tag}{_HEAD}{head}{rest}"


def amended_response(body: bytes, encoding: str | None) -> bytes:
    """Return the page as it is served, encoded as it was."""
    packed = encoding == "gzip"
    page = gzip.decompress(body) if packed else body
    changed = amended(page.decode()).encode()
    return gzip.compress(changed, 1) if packed else changed
