// Draws the skin: image, outline, electrodes with their faults, tracks and touches.
const TRACK_S = 2, SCALE_IMAGES = 50, COLORS = 6, RADIUS = 13;
const FAULTS = { contradicts: "its voltages contradict the others", stuck: "its voltages do not change", drifts: "its voltages drift", flagged: "the instrument marks its values as bad" };
const byId = id => document.getElementById(id);
const style = getComputedStyle(document.documentElement);
const color = name => style.getPropertyValue(name).trim();
const touchColor = id => color("--touch" + (id - 1 + COLORS) % COLORS);
// three numbers of a colour that is written as #rrggbb
const rgb = name => [1, 3, 5].map(i => parseInt(color(name).slice(i, i + 2), 16));

// the end of the colours of both images: steady over some images, and so far up that noise stays pale
function scaleOf(images) {
  let most = 0;
  for (const { line } of images.slice(-SCALE_IMAGES)) most = Math.max(most, line.range_s, line.faintest_s / 2);
  return most || 1;
}

// from the colour of less through the page's own to that of more conductivity; clear outside the skin
function painted(line, part, scale) {
  const bytes = atob(part.pixels), image = new ImageData(line.columns, line.rows), table = new Uint8ClampedArray(1024);
  const ground = rgb("--card"), ends = [rgb("--less"), rgb("--more")];
  for (let byte = 1; byte < 256; byte++) {
    const t = (byte - 128) / 127 * part.range_s / scale, end = ends[t < 0 ? 0 : 1], share = Math.min(1, Math.abs(t));
    table.set([...ground.map((g, k) => g + share * (end[k] - g)), 255], 4 * byte);
  }
  for (let i = 0; i < bytes.length; i++) image.data.set(table.subarray(4 * bytes.charCodeAt(i), 4 * bytes.charCodeAt(i) + 4), 4 * i);
  const picture = document.createElement("canvas");
  picture.width = line.columns; picture.height = line.rows;
  picture.getContext("2d").putImageData(image, 0, 0);
  return picture;
}

// with a prefix, as instruments write it
function siemens(value) {
  const steps = Math.max(-4, Math.min(0, Math.floor(Math.log10(value) / 3)));
  return +(value / 1e3 ** steps).toPrecision(2) + " " + ["S", "mS", "µS", "nS", "pS"][-steps];
}

// a canvas as wide as its place, in units of the page's pixels
function sized(canvas, height) {
  const width = canvas.clientWidth, ratio = window.devicePixelRatio || 1, pen = canvas.getContext("2d");
  const size = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== size[0] || canvas.height !== size[1]) {
    canvas.style.height = height + "px";
    [canvas.width, canvas.height] = size;
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return [pen, width];
}

// where each touch of the frame has been during the last seconds before the time shown
function tracks(frame, frames, at) {
  const found = new Map(frame ? frame.touches.filter(touch => touch.state !== "end").map(touch => [touch.id, []]) : []);
  for (let i = frames.length - 1; i >= 0 && frames[i].at >= at - TRACK_S; i--) {
    if (frames[i].at > at) continue;
    for (const touch of frames[i].line.touches) {
      if (frames[i].line.epoch === frame.epoch && found.has(touch.id)) found.get(touch.id).push(touch.position_m);
    }
  }
  return found;
}

function drawSkin(canvas, skin, picture, frame, frames, at) {
  const [left, right, low, high] = skin.extent_m, margin = .08 * Math.max(right - left, high - low);
  const wide = right - left + 2 * margin, tall = high - low + 2 * margin, scale = canvas.clientWidth / wide, below = 24;
  const [pen, width] = sized(canvas, tall * scale + below);
  const place = ([x, y]) => [(x - left + margin) * scale, (high - y + margin) * scale];
  const path = (points, close) => {
    pen.beginPath();
    points.forEach((p, i) => i ? pen.lineTo(...place(p)) : pen.moveTo(...place(p)));
    if (close) pen.closePath();
  };
  const outline = new Path2D();
  for (const curve of skin.outlines_m) {
    curve.forEach((p, i) => i ? outline.lineTo(...place(p)) : outline.moveTo(...place(p)));
    outline.closePath();
  }
  if (picture) {
    pen.save(); pen.clip(outline, "evenodd");
    pen.drawImage(picture, ...place([left, high]), (right - left) * scale, (high - low) * scale);
    pen.restore();
  }
  pen.font = "12px system-ui, sans-serif"; pen.textAlign = "center"; pen.textBaseline = "middle";
  pen.strokeStyle = color("--line"); pen.lineWidth = 1.5; pen.stroke(outline);
  const faulty = new Set(frame ? frame.faulty_electrodes.map(f => f.electrode) : []), middle = [(left + right) / 2, (low + high) / 2];
  skin.electrodes_m.forEach((points, index) => {
    if (!points.length) return;
    const bad = faulty.has(index + 1), [x, y] = points[points.length >> 1], [dx, dy] = [x - middle[0], y - middle[1]], long = Math.hypot(dx, dy) || 1;
    pen.strokeStyle = pen.fillStyle = color(bad ? "--bad" : "--ink"); pen.lineWidth = bad ? 7 : 4;
    path(points, false); pen.stroke();
    pen.font = bad ? "bold 13px system-ui, sans-serif" : "12px system-ui, sans-serif";
    pen.fillText(bad ? index + 1 + "✕" : index + 1, ...place([x + .55 * margin * dx / long, y + .55 * margin * dy / long]));
  });
  for (const [id, track] of tracks(frame, frames, at)) {
    path(track, false);
    pen.lineJoin = "round";
    pen.strokeStyle = color("--card"); pen.lineWidth = 5; pen.stroke();
    pen.strokeStyle = touchColor(id); pen.lineWidth = 2.5; pen.stroke();
  }
  pen.font = "bold 15px system-ui, sans-serif";
  for (const touch of frame ? frame.touches : []) {
    if (touch.state === "end") continue;
    const [x, y] = place(touch.position_m);
    // a border of the page's colour, so that ring and number stand out from any image
    pen.beginPath(); pen.arc(x, y, RADIUS, 0, 2 * Math.PI);
    pen.strokeStyle = color("--card"); pen.lineWidth = 6.5; pen.stroke();
    pen.strokeStyle = touchColor(touch.id); pen.lineWidth = 3.5;
    pen.setLineDash(touch.valid ? [] : [5, 4]); pen.stroke(); pen.setLineDash([]);
    const name = touch.id + (touch.valid ? "" : "?"), beside = [x + RADIUS + 8, y - RADIUS - 4];
    pen.strokeStyle = color("--card"); pen.lineWidth = 5; pen.lineJoin = "round"; pen.strokeText(name, ...beside);
    pen.fillStyle = color("--ink"); pen.fillText(name, ...beside);
  }
  ruler(pen, scale, wide, tall * scale + below - 4);
}

// a bar of 1, 2 or 5 times a power of ten, at most a quarter of the width, and which way x and y go
function ruler(pen, scale, wide, bottom) {
  const most = .25 * wide, power = 10 ** Math.floor(Math.log10(most)), left = 8;
  const length = [5, 2, 1].map(k => k * power).find(l => l <= most), end = left + length * scale, up = bottom - 26;
  pen.font = "12px system-ui, sans-serif";
  pen.strokeStyle = pen.fillStyle = color("--quiet"); pen.lineWidth = 1.5; pen.setLineDash([]);
  pen.beginPath(); pen.moveTo(left, bottom - 4); pen.lineTo(left, bottom); pen.lineTo(end, bottom); pen.lineTo(end, bottom - 4); pen.stroke();
  pen.textAlign = "left"; pen.fillText(+(1e3 * length).toPrecision(1) + " mm", end + 6, bottom - 3);
  pen.beginPath(); pen.moveTo(left, up - 18); pen.lineTo(left, up); pen.lineTo(left + 18, up);
  pen.moveTo(left - 3, up - 14); pen.lineTo(left, up - 18); pen.lineTo(left + 3, up - 14);
  pen.moveTo(left + 14, up - 3); pen.lineTo(left + 18, up); pen.lineTo(left + 14, up + 3); pen.stroke();
  pen.fillText("x", left + 22, up); pen.fillText("y", left - 3, up - 26); pen.textAlign = "center";
}
