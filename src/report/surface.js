(function () {
  "use strict";
  const canvas = document.getElementById("surface-canvas");
  const select = document.getElementById("surface-name");
  const data = JSON.parse(document.getElementById("surface-data").textContent);
  const context = canvas.getContext("2d");
  const GRID = 0.05; // m
  const LIGHT = [0.35, -0.55, 0.76]; // direction to the light, in the viewer's axes: right, down, towards the viewer
  const bytes = text => new DataView(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);

  const surfaces = data.surfaces.map(packed => {
    const [p, t] = [bytes(packed.points), bytes(packed.triangles)];
    return {
      points: Array.from({ length: p.byteLength / 6 }, (_, k) =>
        [0, 1, 2].map(axis => data.origin[axis] + data.step * p.getUint16(6 * k + 2 * axis, true))),
      triangles: Array.from({ length: t.byteLength / 12 }, (_, k) =>
        [0, 1, 2].map(corner => t.getUint32(12 * k + 4 * corner, true))),
    };
  });
  // One box around all of them, so that they are drawn alike.
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const { points } of surfaces) {
    for (const point of points) {
      point.forEach((x, axis) => {
        low[axis] = Math.min(low[axis], x);
        high[axis] = Math.max(high[axis], x);
      });
    }
  }
  const empty = !(low[0] <= high[0]);
  const center = low.map((x, axis) => (empty ? 0 : (x + high[axis]) / 2));
  const size = empty ? 0.1 : Math.hypot(...low.map((x, axis) => high[axis] - x));
  const camera = {};

  function projection() {
    const scale = camera.zoom * Math.min(canvas.width, canvas.height) / (1.05 * size);
    const [sa, ca, se, ce] = [Math.sin(camera.azimuth), Math.cos(camera.azimuth), Math.sin(camera.elevation), Math.cos(camera.elevation)];
    return {
      scale,
      project([x, y, z]) {
        const [dx, dy, dz] = [x - center[0], y - center[1], z - center[2]];
        const across = ca * dx + sa * dy;
        const away = ca * dy - sa * dx;
        return [canvas.width / 2 + scale * across, canvas.height / 2 - scale * (se * away + ce * dz), scale * (se * dz - ce * away)];
      },
    };
  }

  function line(from, to, color, width) {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.beginPath();
    context.moveTo(from[0], from[1]);
    context.lineTo(to[0], to[1]);
    context.stroke();
  }

  function drawGround({ project }, color, width) {
    const [from, to] = [0, 1].map(axis => [GRID * Math.floor(low[axis] / GRID), GRID * Math.ceil(high[axis] / GRID)])
      .reduce(([a, b], [x, y]) => [[...a, x], [...b, y]], [[], []]);
    const floor = low[2] - 0.05 * size;
    for (let x = from[0]; x < to[0] + GRID / 2; x += GRID) line(project([x, from[1], floor]), project([x, to[1], floor]), color, width);
    for (let y = from[1]; y < to[1] + GRID / 2; y += GRID) line(project([from[0], y, floor]), project([to[0], y, floor]), color, width);
  }

  function drawSurface({ project }) {
    const { points, triangles } = surfaces[select.selectedIndex];
    const placed = points.map(project);
    const faces = triangles.map(triangle => {
      const corners = triangle.map(corner => placed[corner]);
      const [u, v] = [1, 2].map(k => corners[k].map((x, axis) => x - corners[0][axis]));
      const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const length = Math.hypot(...normal) || 1;
      // Faces are lit from both sides: which one is outside does not show.
      const shade = Math.abs(normal.reduce((sum, x, axis) => sum + x * LIGHT[axis], 0)) / length;
      return { corners, depth: corners[0][2] + corners[1][2] + corners[2][2], shade };
    });
    faces.sort((a, b) => a.depth - b.depth);
    for (const { corners, shade } of faces) {
      const tone = [[20, 74, 128], [168, 214, 245]].reduce((dark, light) => dark.map((x, k) => Math.round(x + shade * (light[k] - x))));
      context.fillStyle = context.strokeStyle = `rgb(${tone.join(",")})`;
      context.lineWidth = 0.6;
      context.beginPath();
      corners.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
      context.fill();
      context.stroke();
    }
  }

  function drawScale({ scale, project }, theme, ratio) {
    const target = 130 * ratio / scale; // m
    const decade = 10 ** Math.floor(Math.log10(target));
    const length = [5, 2, 1].map(k => k * decade).find(x => x <= target);
    const [x, y] = [20 * ratio, canvas.height - 20 * ratio];
    line([x, y], [x + length * scale, y], theme.ink, 3 * ratio);
    context.fillStyle = theme.ink;
    context.textAlign = "left";
    context.fillText(`${+(100 * length).toPrecision(2)} cm`, x, y - 6 * ratio);
    const at = [canvas.width - 60 * ratio, canvas.height - 48 * ratio];
    const origin = project(center);
    ["x", "y", "z"].forEach((name, axis) => {
      const tip = project(center.map((c, k) => c + (k === axis ? 32 * ratio / scale : 0)));
      const along = factor => at.map((c, k) => c + factor * (tip[k] - origin[k]));
      line(at, along(1), theme.soft, 1.5 * ratio);
      context.textAlign = "center";
      context.fillText(name, ...along(1.4));
    });
  }

  function draw() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    const style = getComputedStyle(document.documentElement);
    const theme = Object.fromEntries(["ink", "soft", "rule"].map(name => [name, style.getPropertyValue(`--${name}`).trim()]));
    context.font = `${12 * ratio}px system-ui, sans-serif`;
    const view = projection();
    drawGround(view, theme.rule, ratio);
    drawSurface(view);
    drawScale(view, theme, ratio);
  }

  function reset() {
    Object.assign(camera, { azimuth: 0.5, elevation: 0.3, zoom: 1 });
    draw();
  }

  let from = null;
  canvas.addEventListener("pointerdown", event => {
    from = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", event => {
    if (!from) return;
    camera.azimuth -= 0.01 * (event.clientX - from[0]);
    camera.elevation = Math.max(-1.57, Math.min(1.57, camera.elevation + 0.01 * (event.clientY - from[1])));
    from = [event.clientX, event.clientY];
    draw();
  });
  canvas.addEventListener("pointerup", () => { from = null; });
  canvas.addEventListener("wheel", event => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    camera.zoom = Math.max(0.3, Math.min(8, camera.zoom * Math.exp(-0.002 * event.deltaY)));
    draw();
  }, { passive: false });
  select.addEventListener("change", draw);
  document.getElementById("surface-reset").addEventListener("click", reset);
  window.addEventListener("resize", draw);
  reset();
})();
