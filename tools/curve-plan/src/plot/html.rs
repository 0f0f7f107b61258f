//! The picture as a page that can be moved and zoomed: one file that loads nothing. It shows the values of the route
//! under the pointer, and a scale in its corner.

use cucs::formats::escaped;

use super::scene::Scene;
use super::svg::{self, Theme};

/// A page around the picture of a scene.
pub(crate) fn page(scene: &Scene, theme: &Theme) -> String {
    let (samples, metre) = svg::hover(scene);
    let picture = svg::draw(scene, theme);
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{}</title>\n<style>body{{background:{};color:{}}}{STYLE}</style></head>\n\
         <body><p>Drag to move, turn the wheel to zoom, double click for all of it.</p>\n{picture}\
         <div id=\"values\"></div><div id=\"scale\"><span></span></div>\n\
         <script>const samples = {samples}, metre = {metre};{SCRIPT}</script></body></html>\n",
        escaped(&scene.title),
        theme.paper,
        theme.ink,
    )
}

// The picture takes the rest of the window: a page that scrolls would react to the wheel twice.
const STYLE: &str = "html,body{height:100%;overflow:hidden}body{margin:0;font-family:sans-serif;display:flex;flex-direction:column}\
p{margin:.4em 1em;opacity:.7}body>svg{flex:1;min-height:0;width:100%;cursor:grab;touch-action:none}\
#values{position:fixed;display:none;padding:.3em .6em;background:#222e;color:#fff;font-size:13px;white-space:pre;pointer-events:none;border-radius:4px}\
#scale{position:fixed;right:1em;top:1.6em;height:6px;border:2px solid;border-top:0;opacity:.7;pointer-events:none}\
#scale span{position:absolute;bottom:8px;right:0;font-size:13px;white-space:nowrap}";

const SCRIPT: &str = r#"
const svg = document.querySelector('svg'), all = svg.getAttribute('viewBox').split(' ').map(Number);
const values = document.getElementById('values'), scale = document.getElementById('scale');
svg.removeAttribute('width'); svg.removeAttribute('height');
const dot = document.createElementNS('http://www.w3.org/2000/svg', 'circle');
dot.setAttribute('fill', 'none'); dot.setAttribute('stroke', '#888'); dot.setAttribute('stroke-width', 2);
svg.append(dot);
let box = all.slice(), grip = null;
const show = () => {
  svg.setAttribute('viewBox', box.join(' '));
  const pixels = svg.getScreenCTM().a * metre, most = 160 / pixels;
  const power = 10 ** Math.floor(Math.log10(most));
  const bar = power * [5, 2, 1].find(k => k * power <= most);
  scale.style.width = bar * pixels + 'px';
  scale.firstChild.textContent = bar >= 1000 ? bar / 1000 + ' km' : bar + ' m';
};
const point = e => new DOMPoint(e.clientX, e.clientY).matrixTransform(svg.getScreenCTM().inverse());
const hover = e => {
  const p = point(e), zoom = svg.getScreenCTM().a;
  let best = null, least = 20 / zoom;
  for (const s of samples) {
    const d = Math.hypot(s[0] - p.x, s[1] - p.y);
    if (d < least) { least = d; best = s; }
  }
  values.style.display = best ? 'block' : 'none';
  dot.setAttribute('r', best ? 6 / zoom : 0);
  if (!best) return;
  const [x, y, lat, lon, alt, along, off, radius, flown] = best;
  dot.setAttribute('cx', x); dot.setAttribute('cy', y); dot.setAttribute('stroke-width', 2 / zoom);
  values.textContent = `${lat.toFixed(7)}, ${lon.toFixed(7)}\naltitude ${alt} m\n${along} m along the route\n` +
    `deviation ${off} m\n` + (flown === null ? '' : `flown deviation ${flown} m\n`) + (radius ? `radius ${radius} m` : 'straight');
  values.style.left = Math.min(e.clientX + 16, innerWidth - 230) + 'px';
  values.style.top = Math.min(e.clientY + 16, innerHeight - 126) + 'px';
};
svg.addEventListener('wheel', e => {
  e.preventDefault();
  const p = point(e), k = Math.exp(e.deltaY * 0.0015);
  box = [p.x + (box[0] - p.x) * k, p.y + (box[1] - p.y) * k, box[2] * k, box[3] * k];
  show();
}, { passive: false });
svg.addEventListener('pointerdown', e => { grip = point(e); svg.setPointerCapture(e.pointerId); });
svg.addEventListener('pointermove', e => {
  if (!grip) return hover(e);
  const p = point(e);
  box[0] += grip.x - p.x; box[1] += grip.y - p.y;
  show();
});
svg.addEventListener('pointerup', () => { grip = null; });
svg.addEventListener('pointerleave', () => { values.style.display = 'none'; dot.setAttribute('r', 0); });
svg.addEventListener('dblclick', () => { box = all.slice(); show(); });
addEventListener('resize', show);
show();
"#;
