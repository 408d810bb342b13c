// A strip chart on a canvas: lines over time that follow, or a whole recording with a line at the time that is shown.

import { shown } from "#live/numbers";

export const LINES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#882255", "#56b4e9", "#999999"];

/** About `count` round numbers from low to high. */
export function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0) || !Number.isFinite(span)) return [low];
  const rough = span / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((x) => x * power >= rough) ?? 10);
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * span; i++) found.push(i === 0 ? 0 : i * step);
  return found;
}

/** Least and largest value of rows' columns, a little apart. */
export function range(rows, columns) {
  let low = Infinity, high = -Infinity;
  for (const row of rows) {
    for (let i = 0; i < columns; i++) {
      if (row[i] < low) low = row[i];
      if (row[i] > high) high = row[i];
    }
  }
  if (!(low <= high)) return [-1, 1];
  const least = 1e-12 + 1e-6 * Math.max(Math.abs(low), Math.abs(high));
  const gap = Math.max(0.08 * (high - low), least);
  return [low - gap, high + gap];
}

/**
 * Draw lines.  times: (T,), s; rows: T arrays of a value per name; span: [first, last] time; cursor: a time or null.
 */
export function drawChart(canvas, { times, rows, names, unit, span, cursor = null }) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !height) return;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d"), style = getComputedStyle(canvas);
  const ink = style.color, faint = style.getPropertyValue("--line") || "#ddd";
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "11px system-ui, sans-serif";
  const box = { left: 52, right: width - 8, top: 20, bottom: height - 18 };
  const [low, high] = range(rows, names.length), [first, last] = span;
  const x = (t) => box.left + ((t - first) / (last - first || 1)) * (box.right - box.left);
  const y = (value) => box.bottom - ((value - low) / (high - low)) * (box.bottom - box.top);
  pen.lineWidth = 1;
  pen.textBaseline = "middle";
  pen.textAlign = "right";
  for (const value of ticks(low, high, Math.max(2, (box.bottom - box.top) / 28))) {
    pen.strokeStyle = faint;
    pen.beginPath();
    pen.moveTo(box.left, y(value));
    pen.lineTo(box.right, y(value));
    pen.stroke();
    pen.fillStyle = ink;
    pen.fillText(shown(value, 4), box.left - 5, y(value));
  }
  pen.textAlign = "center";
  pen.textBaseline = "top";
  for (const t of ticks(first, last, Math.max(2, (box.right - box.left) / 90))) pen.fillText(`${shown(t, 5)} s`, Math.min(Math.max(x(t), box.left + 8), box.right - 12), box.bottom + 4);
  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top - 2, box.right - box.left, box.bottom - box.top + 4);
  pen.clip();
  pen.lineWidth = 1.6;
  pen.lineJoin = "round";
  names.forEach((_, line) => {
    pen.strokeStyle = LINES[line % LINES.length];
    pen.beginPath();
    rows.forEach((row, i) => (i ? pen.lineTo(x(times[i]), y(row[line])) : pen.moveTo(x(times[i]), y(row[line]))));
    pen.stroke();
  });
  if (cursor !== null) {
    pen.strokeStyle = ink;
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(x(cursor), box.top);
    pen.lineTo(x(cursor), box.bottom);
    pen.stroke();
  }
  pen.restore();
  pen.textBaseline = "middle";
  pen.textAlign = "right";
  pen.fillStyle = ink;
  pen.fillText(unit, box.right, 10);
  pen.textAlign = "left";
  let at = box.left;
  const end = box.right - pen.measureText(unit).width - 12;
  for (const [line, name] of names.entries()) {
    if (at + 16 + pen.measureText(name).width > end) {
      pen.fillText("...", at, 10);
      break;
    }
    pen.fillStyle = LINES[line % LINES.length];
    pen.fillRect(at, 8, 12, 3);
    pen.fillStyle = ink;
    pen.fillText(name, at + 16, 10);
    at += 26 + pen.measureText(name).width;
  }
}
