//! The picture in a page of its own, to be moved and zoomed: one file, nothing fetched.

use cucs::formats::escaped;

/// A page around an SVG.
pub(crate) fn page(title: &str, svg: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{}</title>\n<style>{STYLE}</style></head>\n\
         <body><p>Drag to move, turn the wheel to zoom, double click for all of it.</p>\n{svg}<script>{SCRIPT}</script></body></html>\n",
        escaped(title)
    )
}

const STYLE: &str = "body{margin:0;font-family:sans-serif;background:#eee}p{margin:.4em 1em;color:#555}\
svg{display:block;width:100vw;height:calc(100vh - 2.2em);cursor:grab;touch-action:none}";

const SCRIPT: &str = r#"
const svg = document.querySelector('svg'), all = svg.getAttribute('viewBox').split(' ').map(Number);
svg.removeAttribute('width'); svg.removeAttribute('height');
let box = all.slice(), grip = null;
const show = () => svg.setAttribute('viewBox', box.join(' '));
const point = e => new DOMPoint(e.clientX, e.clientY).matrixTransform(svg.getScreenCTM().inverse());
svg.addEventListener('wheel', e => {
  e.preventDefault();
  const p = point(e), k = Math.exp(e.deltaY * 0.0015);
  box = [p.x + (box[0] - p.x) * k, p.y + (box[1] - p.y) * k, box[2] * k, box[3] * k];
  show();
}, { passive: false });
svg.addEventListener('pointerdown', e => { grip = point(e); svg.setPointerCapture(e.pointerId); });
svg.addEventListener('pointermove', e => {
  if (!grip) return;
  const p = point(e);
  box[0] += grip.x - p.x; box[1] += grip.y - p.y;
  show();
});
svg.addEventListener('pointerup', () => { grip = null; });
svg.addEventListener('dblclick', () => { box = all.slice(); show(); });
"#;
