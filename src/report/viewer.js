(function () {
  "use strict";
  const section = document.getElementById("viewer");
  const canvas = document.getElementById("viewer-canvas");
  const select = document.getElementById("viewer-example");
  const boxes = [...section.querySelectorAll("input[data-cloud]")];
  const data = JSON.parse(document.getElementById("viewer-data").textContent);
  const context = canvas.getContext("2d");
  const GRID = 0.05; // m
  const RADIUS = 0.0013; // of a point, m
  const [ASIDE, ELEVATION] = [-0.5, 0.35]; // first view, from that of the still pictures and the horizon, rad
  const SHADES = 16;
  const COLORS = { truth: "--truth", prediction: "--network", nearest: "--nearest" };

  // Clouds in metres: [x0, y0, z0, x1, ...].
  function unpack(text) {
    const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Float32Array.from({ length: bytes.length / 2 }, (_, k) =>
      data.origin[k % 3] + data.step * view.getUint16(2 * k, true));
  }
  // The box around clouds: its low and high corner.
  function box(clouds) {
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (const cloud of clouds) {
      cloud.forEach((x, k) => {
        low[k % 3] = Math.min(low[k % 3], x);
        high[k % 3] = Math.max(high[k % 3], x);
      });
    }
    return low[0] <= high[0] ? { low, high } : { low: [0, 0, 0], high: [0, 0, 0.1] };
  }
  const examples = data.examples.map(example => {
    const clouds = Object.fromEntries(Object.keys(COLORS).map(name => [name, unpack(example[name])]));
    return { azimuth: example.azimuth, clouds, box: box(Object.values(clouds)) };
  });
  const floor = Math.min(...examples.map(example => example.box.low[2])); // height of the ground, m
  const size = Math.max(0.05, ...examples.map(({ box: { low, high } }) => Math.hypot(...low.map((x, k) => high[k] - x))));

  const camera = {};
  function reset() {
    const { azimuth, box: { low, high } } = examples[select.selectedIndex];
    const center = low.map((x, k) => (x + high[k]) / 2);
    Object.assign(camera, { center, azimuth: azimuth + ASIDE, elevation: ELEVATION, zoom: 1 });
    draw();
  }

  // Scale (pixels per metre) and the map from the world to (right, down, toward the viewer), all in pixels.
  function projection() {
    const { width, height } = canvas;
    const scale = camera.zoom * Math.min(width, height) / (1.1 * size);
    const [sa, ca, se, ce] = [Math.sin(camera.azimuth), Math.cos(camera.azimuth), Math.sin(camera.elevation), Math.cos(camera.elevation)];
    const project = (x, y, z) => {
      const [dx, dy, dz] = [x - camera.center[0], y - camera.center[1], z - camera.center[2]];
      const across = ca * dx + sa * dy;
      const away = ca * dy - sa * dx;
      return [width / 2 + scale * across, height / 2 - scale * (se * away + ce * dz), scale * (se * dz - ce * away)];
    };
    return { scale, project };
  }

  function line(from, to, color, width) {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.beginPath();
    context.moveTo(from[0], from[1]);
    context.lineTo(to[0], to[1]);
    context.stroke();
  }

  function drawGround({ project }, theme, ratio) {
    const { low, high } = examples[select.selectedIndex].box;
    const from = [0, 1].map(k => GRID * Math.floor(Math.min(0, low[k]) / GRID));
    const to = [0, 1].map(k => GRID * Math.ceil(Math.max(0, high[k]) / GRID));
    for (let x = from[0]; x < to[0] + GRID / 2; x += GRID) line(project(x, from[1], floor), project(x, to[1], floor), theme.rule, ratio);
    for (let y = from[1]; y < to[1] + GRID / 2; y += GRID) line(project(from[0], y, floor), project(to[0], y, floor), theme.rule, ratio);
  }

  // Directions of the world's axes, at the lower right.
  function drawAxes({ scale, project }, theme, ratio) {
    const length = 32 * ratio / scale;
    const origin = project(...camera.center);
    const at = [canvas.width - 60 * ratio, canvas.height - 48 * ratio];
    context.fillStyle = theme.soft;
    context.textAlign = "center";
    context.textBaseline = "middle";
    ["x", "y", "z"].forEach((name, axis) => {
      const tip = project(...camera.center.map((c, k) => c + (k === axis ? length : 0)));
      const along = factor => at.map((c, k) => c + factor * (tip[k] - origin[k]));
      line(at, along(1), theme.soft, 1.5 * ratio);
      context.fillText(name, ...along(1.35));
    });
  }

  // Round points, fading into the background with distance: one small picture per colour and shade.
  function sprites(radius, theme) {
    const side = Math.ceil(2 * radius) + 2;
    const make = (color, fade) => {
      const sprite = Object.assign(document.createElement("canvas"), { width: side, height: side });
      const pen = sprite.getContext("2d");
      for (const [fill, alpha] of [[color, 1], [theme.panel, fade]]) {
        pen.globalAlpha = alpha;
        pen.fillStyle = fill;
        pen.beginPath();
        pen.arc(side / 2, side / 2, radius, 0, 2 * Math.PI);
        pen.fill();
      }
      return sprite;
    };
    return Object.fromEntries(Object.entries(COLORS).map(([name, color]) => [name,
      Array.from({ length: SHADES }, (_, k) => make(theme[color], 0.5 * (1 - k / (SHADES - 1))))]));
  }

  function drawPoints({ scale, project }, theme, ratio) {
    const radius = Math.max(RADIUS * scale, ratio);
    const kinds = sprites(radius, theme);
    const points = [];
    for (const box of boxes.filter(b => b.checked)) {
      const cloud = examples[select.selectedIndex].clouds[box.dataset.cloud];
      for (let k = 0; k < cloud.length; k += 3) {
        points.push([...project(cloud[k], cloud[k + 1], cloud[k + 2]), kinds[box.dataset.cloud]]);
      }
    }
    points.sort((a, b) => a[2] - b[2]);
    const far = points.length ? points[0][2] : 0;
    const span = points.length ? Math.max(1e-9, points[points.length - 1][2] - far) : 1;
    for (const [u, v, depth, shades] of points) {
      const sprite = shades[Math.round((SHADES - 1) * (depth - far) / span)];
      context.drawImage(sprite, u - sprite.width / 2, v - sprite.height / 2);
    }
  }

  function drawScaleBar({ scale }, theme, ratio) {
    const target = 130 * ratio / scale; // m
    const decade = 10 ** Math.floor(Math.log10(target));
    const length = [5, 2, 1].map(k => k * decade).find(x => x <= target);
    const [x, y] = [20 * ratio, canvas.height - 20 * ratio];
    line([x, y], [x + length * scale, y], theme.ink, 3 * ratio);
    context.fillStyle = theme.ink;
    context.textAlign = "left";
    context.textBaseline = "bottom";
    context.fillText(`${+(100 * length).toPrecision(2)} cm`, x, y - 5 * ratio);
  }

  function draw() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    const style = getComputedStyle(document.documentElement);
    const theme = Object.fromEntries(["ink", "soft", "rule", "panel"].map(name => [name, style.getPropertyValue(`--${name}`).trim()]));
    for (const color of Object.values(COLORS)) theme[color] = style.getPropertyValue(color).trim();
    context.font = `${13 * ratio}px system-ui, sans-serif`;
    const view = projection();
    drawGround(view, theme, ratio);
    drawPoints(view, theme, ratio);
    drawAxes(view, theme, ratio);
    drawScaleBar(view, theme, ratio);
  }

  let pending = false;
  function redraw() {
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => { pending = false; draw(); });
  }
  function turn(across, down) {
    camera.azimuth -= across;
    // From the horizon to straight above, so that the ground stays behind the robot.
    camera.elevation = Math.min(Math.PI / 2, Math.max(0, camera.elevation + down));
    redraw();
  }
  function zoom(factor) {
    camera.zoom = Math.min(12, Math.max(0.4, camera.zoom * factor));
    redraw();
  }

  canvas.addEventListener("pointerdown", event => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", event => {
    if (canvas.hasPointerCapture(event.pointerId)) turn(0.008 * event.movementX, 0.008 * event.movementY);
  });
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    zoom(Math.exp(-0.0015 * event.deltaY));
  }, { passive: false });
  const keys = {
    ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0),
    ArrowUp: () => turn(0, -0.1), ArrowDown: () => turn(0, 0.1),
    "+": () => zoom(1.2), "=": () => zoom(1.2), "-": () => zoom(1 / 1.2),
  };
  canvas.addEventListener("keydown", event => {
    if (keys[event.key]) {
      event.preventDefault();
      keys[event.key]();
    }
  });
  select.addEventListener("change", reset);
  boxes.forEach(box => box.addEventListener("change", redraw));
  document.getElementById("viewer-reset").addEventListener("click", reset);
  new ResizeObserver(redraw).observe(canvas);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

  section.hidden = false;
  reset();
})();
