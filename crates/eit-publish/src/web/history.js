"use strict";
// What arrived in the last minute, and which moment of it is shown. Times are seconds on the page's own clock.
const SPAN_S = 60;
const now = () => performance.now() / 1e3;
const past = { frames: [], images: [], lost: [] };
// null: live; else what was there at the pause, and the time shown
let held = null;

function remember(list, item) {
  list.push(item);
  const oldest = item.at - SPAN_S;
  let old = 0;
  while (list[old].at < oldest) old++;
  if (old) list.splice(0, old);
}

const lists = () => held || past;
const endOf = list => list.length ? list[list.length - 1].at : now();
// time that is shown
const shownAt = () => held ? held.at : endOf(past.frames);

// the last item that had arrived at the time shown
function shown(list) {
  if (!held) return list[list.length - 1] || null;
  let low = 0, high = list.length;
  while (low < high) { const middle = (low + high) >> 1; if (list[middle].at <= held.at) low = middle + 1; else high = middle; }
  return list[low - 1] || null;
}

function pause() {
  if (!held) held = { frames: past.frames.slice(), images: past.images.slice(), lost: past.lost.slice(), at: endOf(past.frames), end: endOf(past.frames) };
}

// how many seconds before the pause can be shown
const spanHeld = () => held.frames.length ? Math.min(SPAN_S, held.end - held.frames[0].at) : 0;
