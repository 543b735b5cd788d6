// Curves of the last minute: one colour per touch, interrupted where the touch or the frames are.
const BREAK_S = .5, CHART_HEIGHT = 112;

// a round number at or above
function round(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map(k => k * power).find(k => k >= .999 * value);
}

function drawChart(canvas, frames, end, at, [low, high], valueOf) {
  const [pen, width] = sized(canvas, CHART_HEIGHT), top = 6, bottom = CHART_HEIGHT - 18;
  pen.font = "11px system-ui, sans-serif"; pen.textBaseline = "middle";
  const names = [low, (low + high) / 2, high].map(value => +value.toPrecision(3) + "");
  const left = 6 + Math.max(...names.map(name => pen.measureText(name).width)), right = width - 4;
  const x = time => right + (time - end) / SPAN_S * (right - left), y = value => bottom + (value - low) / (high - low) * (top - bottom);
  pen.strokeStyle = color("--rule"); pen.fillStyle = color("--quiet"); pen.lineWidth = 1; pen.textAlign = "right";
  names.forEach((name, i) => {
    const line = y(low + i / 2 * (high - low));
    pen.beginPath(); pen.moveTo(left, line); pen.lineTo(right, line); pen.stroke();
    pen.fillText(name, left - 4, line);
  });
  [[left, "left", "60 s ago"], [(left + right) / 2, "center", "30 s"], [right, "right", held ? "pause" : "now"]].forEach(([place, align, text]) => { pen.textAlign = align; pen.fillText(text, place, CHART_HEIGHT - 7); });
  const series = new Map();
  for (const { at: time, line } of frames) for (const touch of line.touches) {
    const value = valueOf(touch);
    if (touch.state === "end" || value === null) continue;
    const key = line.epoch + " " + touch.id;
    if (!series.has(key)) series.set(key, { id: touch.id, points: [] });
    series.get(key).points.push([time, value]);
  }
  pen.save(); pen.beginPath(); pen.rect(left, 0, right - left + 2, bottom + 2); pen.clip();
  pen.lineWidth = 2; pen.lineJoin = "round";
  for (const { id, points } of series.values()) {
    pen.strokeStyle = touchColor(id); pen.beginPath();
    points.forEach(([time, value], i) => i && time - points[i - 1][0] < BREAK_S ? pen.lineTo(x(time), y(value)) : pen.moveTo(x(time), y(value)));
    pen.stroke();
  }
  pen.restore();
  pen.strokeStyle = color("--ink"); pen.lineWidth = 1; pen.beginPath(); pen.moveTo(x(at), top); pen.lineTo(x(at), bottom); pen.stroke();
}

function drawCharts(skin, frames, end, at) {
  const touches = frames.flatMap(frame => frame.line.touches), isForce = touches.some(touch => touch.force_n !== null);
  const strength = touch => isForce ? touch.force_n : Math.abs(touch.intensity_s_m2);
  const most = touches.reduce((most, touch) => Math.max(most, strength(touch) || 0), 0);
  const [left, right, low, high] = skin.extent_m.map(value => 1e3 * value);
  byId("chart-name").textContent = isForce ? "force, N" : "strength, nS m²";
  drawChart(byId("chart-x"), frames, end, at, [left, right], touch => 1e3 * touch.position_m[0]);
  drawChart(byId("chart-y"), frames, end, at, [low, high], touch => 1e3 * touch.position_m[1]);
  drawChart(byId("chart-force"), frames, end, at, [0, most ? round((isForce ? 1 : 1e9) * most) : 1], touch => strength(touch) === null ? null : (isForce ? 1 : 1e9) * strength(touch));
}
