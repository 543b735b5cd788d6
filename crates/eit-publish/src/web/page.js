// Receives lines, and shows the moment that is chosen.
// what a frame says of the skin where its touches are not known
const UNKNOWN = { not_explained: "touches do not explain the frame", frozen: "the instrument repeats an old frame", no_data: "no data" };
const RATE_FRAMES = 30, SILENT_S = .5, LATENCY_S = 10, NUMBERS_EVERY_S = .1;
let skin = null, heard = null, note = "", halt = "", isStale = true, numbersAt = -1;
let pictures = { item: null, before: null, main: null };

function take(line) {
  const at = now();
  if (line.type === "skin") { skin = line; byId("name").textContent = "Skin “" + line.name + "”"; document.title = line.name + ": touches"; }
  // a list without data only ends touches
  if (line.type === "frame" && line.state !== "no_data") { heard = at; stop("", ""); }
  if (line.type === "frame") remember(past.frames, { at, line });
  if (line.type === "image") remember(past.images, { at, line });
  if (line.type === "event") news(line, at);
  if (line.type === "recording") recording(line);
  isStale = true;
}

function news(line, at) {
  if (line.event === "gap" || line.event === "skipped") remember(past.lost, { at, frames: line.frames });
  if (["reference_started", "disconnected"].includes(line.event) || (line.event === "notice" && heard === null)) stop(line.event === "reference_started" ? "Getting ready: do not touch" : heard === null ? "" : "No signal", line.text);
  if (line.event === "ended") stop("Ended", "The program has ended. You can still look at the last minute.");
  if (["reference_taken", "reconnected"].includes(line.event)) stop("", "");
  const list = byId("news"), item = document.createElement("li");
  item.textContent = new Date().toLocaleTimeString() + "  " + line.text;
  if (!list.dataset.used) { list.dataset.used = "yes"; list.replaceChildren(); }
  list.prepend(item);
  while (list.children.length > 6) list.lastChild.remove();
}

// what the page says in large and in small letters until frames come again
function stop(large, small) { halt = large; note = small; }

function draw() {
  requestAnimationFrame(draw);
  const time = now();
  if (time - numbersAt >= NUMBERS_EVERY_S) { numbersAt = time; state(); if (skin) numbers(); }
  if (!isStale || !skin) return;
  isStale = false;
  const { frames, images } = lists(), item = shown(images), frame = shown(frames);
  if (item !== pictures.item) {
    const scale = item ? scaleOf(images.filter(other => other.at <= item.at)) : 1;
    pictures = { item, main: item && painted(item.line, item.line, scale), before: item && item.line.raw && painted(item.line, item.line.raw, scale) };
    byId("colors").hidden = !item;
    byId("least").textContent = "−" + siemens(scale); byId("most").textContent = "+" + siemens(scale);
    const two = Boolean(pictures.before);
    byId("before").hidden = !two; byId("main").firstElementChild.hidden = !two; byId("pictures").classList.toggle("two", two);
  }
  const line = frame && frame.line, at = shownAt();
  if (pictures.before) drawSkin(byId("before").lastElementChild, skin, pictures.before, line, frames, at);
  drawSkin(byId("main").lastElementChild, skin, pictures.main, line, frames, at);
}

const alive = frame => frame ? frame.line.touches.filter(touch => touch.state !== "end") : [];
const say = (id, text) => { const place = byId(id); if (place.textContent !== text) place.textContent = text; };
const median = values => values.length ? values.sort((a, b) => a - b)[values.length >> 1] : null;
const ms = seconds => seconds >= 1 ? seconds.toFixed(1) + " s" : (1e3 * seconds).toFixed(seconds < .01 ? 1 : 0) + " ms";

function strengthOf(touch) {
  if (touch.force_n === null) return (1e9 * touch.intensity_s_m2).toPrecision(2);
  return touch.force_n.toFixed(2) + (touch.force_std_n === null ? "" : " ± " + touch.force_std_n.toFixed(2));
}

function numbers() {
  const { frames, images, lost } = lists(), frame = shown(frames), touches = alive(frame), at = shownAt(), image = shown(images);
  const end = held ? held.end : frames.length && now() - endOf(frames) < SILENT_S ? now() : endOf(frames);
  drawCharts(skin, frames, end, held ? at : end);
  const count = touches.filter(touch => touch.valid).length, unsure = touches.length - count, doubt = frame && UNKNOWN[frame.line.state];
  const counted = [count && (count === 1 ? "1 touch" : count + " touches"), unsure && unsure + " uncertain"].filter(Boolean).join(", ");
  const isOld = !held && frame && (note || isSilent());
  say("verdict", isOld ? halt || "No signal" : doubt ? "Not known: " + doubt : frame ? counted || "No touch." : halt || "Waiting for the skin …");
  byId("pictures").classList.toggle("old", Boolean(isOld));
  byId("none").hidden = !frame || Boolean(doubt) || touches.length > 0;
  byId("unsure").hidden = touches.every(touch => touch.valid);
  rows(touches);
  const where = touches.map(touch => `touch ${touch.id} at x ${(1e3 * touch.position_m[0]).toFixed(0)} mm, y ${(1e3 * touch.position_m[1]).toFixed(0)} mm`);
  byId("main").lastElementChild.setAttribute("aria-label", "The skin seen from above: " + (doubt ? "not known: " + doubt : where.join("; ") || "no touch"));
  const seen = frames.filter(item => item.at <= at), recent = seen.slice(-RATE_FRAMES).filter(item => item.line.epoch === frame.line.epoch);
  const [first, last] = [recent[0], recent[recent.length - 1]], span = last ? last.line.time_s - first.line.time_s : 0;
  say("rate", span > 0 ? ((last.line.sequence - first.line.sequence) / span).toFixed(0) : "–");
  const delays = seen.filter(item => item.at >= at - LATENCY_S && item.line.latency_s !== null).map(item => item.line.latency_s);
  say("latency", delays.length ? ms(median(delays)) : frame ? "replay" : "–");
  say("lost", "" + lost.filter(item => item.at <= at).reduce((sum, item) => sum + item.frames, 0));
  const longest = seen.reduce((most, item, i) => i ? Math.max(most, item.at - seen[i - 1].at) : 0, 0);
  say("longest", seen.length > 1 ? ms(longest) : "–");
  byId("exact").hidden = !image || image.line.gap === null;
  if (image && image.line.gap !== null) say("gap", (100 * image.line.gap).toPrecision(2) + " %");
  const faults = frame ? frame.line.faulty_electrodes : [];
  byId("out").hidden = !faults.length;
  byId("electrodes").className = faults.length ? "bad" : "";
  say("electrodes", faults.length ? "Left out: " + faults.map(f => `electrode ${f.electrode} (${FAULTS[f.fault] || f.fault})`).join(", ") + ". Touches are found with the others." : frame ? `All ${skin.electrodes_m.length} electrodes work.` : "–");
}

function rows(touches) {
  byId("touches").replaceChildren(...touches.map(touch => {
    const row = document.createElement("tr");
    if (!touch.valid) row.className = "uncertain";
    if (touch.unlike) row.title = "unlike every press that was learnt";
    const speed = 1e3 * Math.hypot(...touch.velocity_m_s);
    for (const text of ["", (1e3 * touch.position_m[0]).toFixed(1), (1e3 * touch.position_m[1]).toFixed(1), speed.toFixed(0), strengthOf(touch)]) {
      const cell = document.createElement("td");
      cell.textContent = text;
      row.append(cell);
    }
    const dot = document.createElement("i");
    dot.style.background = touchColor(touch.id);
    row.firstChild.append(dot, touch.id + (touch.valid ? "" : "?"));
    return row;
  }));
  say("strength", touches.some(touch => touch.force_n !== null) ? "force, N" : "strength, nS m²");
}

const isReplay = () => { const last = lists().frames.at(-1); return Boolean(last) && last.line.state !== "no_data" && last.line.latency_s === null; };
const isSilent = () => heard !== null && now() - heard > SILENT_S;

function state() {
  const label = byId("state"), isBad = !note && isSilent();
  label.className = isBad || halt === "No signal" ? "bad" : "hint";
  say("state", note || (heard === null ? "Connected: waiting for the skin." : isBad ? `Nothing from the skin for ${(now() - heard).toFixed(1)} s: the picture is old.` : isReplay() ? "Recording: what happened then." : "Live: what happens on the skin now."));
  say("when", held ? `paused: ${(now() - held.at).toFixed(1)} s ago` : isReplay() ? "recording" : "live");
}

function toLive() { held = null; byId("scrub").value = 0; byId("scrub").min = -SPAN_S; toggled(); }
function toggled() { say("pause", held ? "Back to live" : "Pause"); isStale = true; numbersAt = -1; }
function toPause() { pause(); byId("scrub").min = -spanHeld().toFixed(1); byId("scrub").value = 0; toggled(); }
byId("pause").addEventListener("click", () => held ? toLive() : toPause());
byId("scrub").addEventListener("input", () => {
  const back = +byId("scrub").value;
  if (!held) { pause(); byId("scrub").min = -spanHeld().toFixed(1); }
  held.at = held.end + Math.max(back, -spanHeld());
  toggled();
});
// the space bar pauses, unless a button has the focus and takes it
addEventListener("keydown", event => {
  if (event.key !== " " || event.target.closest("button")) return;
  event.preventDefault();
  byId("pause").click();
});

let isRecording = false;
function recording(line) {
  const button = byId("record"), hasToken = location.search.includes("token=");
  isRecording = line.state === "on";
  button.hidden = false;
  button.disabled = !hasToken || (isRecording && !line.can_stop);
  button.textContent = isRecording ? "Stop recording" : "Record";
  button.className = isRecording ? "on" : "";
  const text = { on: `Recording to ${line.file}`, failed: `Not recorded: ${line.error}`, off: line.file ? `Recorded: ${line.file}` : "" }[line.state];
  say("recording", text || (hasToken ? "" : "To record, open the address with the token that the program printed."));
}
byId("record").addEventListener("click", async () => {
  byId("record").disabled = true;
  const answer = await fetch((isRecording ? "record/stop" : "record/start") + location.search, { method: "POST" }).catch(() => null);
  if (!answer || !answer.ok) { say("recording", "The program did not accept that."); byId("record").disabled = false; }
});

const events = new EventSource("events" + location.search);
events.onmessage = message => take(JSON.parse(message.data));
events.onerror = () => { if (!note) stop("No signal", "The program does not answer. You can still look at the last minute."); };
events.onopen = () => { stop("", ""); };
addEventListener("resize", () => { isStale = true; numbersAt = -1; });
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { pictures.item = undefined; isStale = true; });
draw();
