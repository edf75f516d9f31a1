"use strict";
// The panel: a path on a table, beside what a model believes of every path and what is true of it.
// Its data are packed by pipeline/report/panel.py. Lengths are metres; x points right, y up.

const data = JSON.parse(document.getElementById("panel-data").textContent);
const cell = (data.high - data.low) / data.side;
const palette = bytes(data.palette); // (256, 3)
let z = [0.3, 0.8].map(coordinate => middle(cellOf(coordinate))); // the control point
let shown; // what the choices amount to: scene, table, user, variant, and the repair if one is followed

function element(name) {
  return document.getElementById(`panel-${name}`);
}

function bytes(text) {
  return Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
}

// Geometry: as pipeline/table/rules.py has it

function curve(z) {
  const [from, to] = data.ends;
  return Array.from({ length: data.samples }, (_, i) => {
    const t = i / (data.samples - 1);
    return [0, 1].map(k => (1 - t) ** 2 * from[k] + 2 * t * (1 - t) * z[k] + t ** 2 * to[k]);
  });
}

// The point of an item's segment nearest to p.
function onAxis(item, p) {
  const [a, b] = item.ends;
  const along = [b[0] - a[0], b[1] - a[1]];
  const share = ((p[0] - a[0]) * along[0] + (p[1] - a[1]) * along[1]) / Math.max(along[0] ** 2 + along[1] ** 2, 1e-18);
  const t = Math.min(Math.max(share, 0), 1);
  return [a[0] + t * along[0], a[1] + t * along[1]];
}

// The least distance from a path to an item's footprint, negative inside: the vertex of the parabola through the three
// nearest squared distances; and the path's point nearest to it.
function clearance(item, points) {
  const squares = points.map(p => {
    const q = onAxis(item, p);
    return (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2;
  });
  const least = squares.indexOf(Math.min(...squares));
  const i = Math.min(Math.max(least, 1), squares.length - 2);
  const [before, at, after] = squares.slice(i - 1, i + 2);
  const bend = Math.max(before - 2 * at + after, 1e-18);
  const offset = Math.min(Math.max((0.5 * (before - after)) / bend, -1), 1);
  const square = at - 0.5 * offset * (before - after) + 0.5 * offset ** 2 * bend;
  return { distance: Math.sqrt(Math.max(square, 0)) - item.radius, point: points[least] };
}

// Every item with its clearance, the margin this user keeps from it (null: none) and the room left; least room first.
function encounters(table, user, z) {
  const points = curve(z);
  return table.items
    .map(item => {
      const margin = user.margins[item.symbol];
      const met = clearance(item, points);
      return { item, margin, ...met, room: margin === null ? Infinity : met.distance - margin };
    })
    .sort((one, other) => one.room - other.room || one.distance - other.distance);
}

// Choices

function chosen(name) {
  return Number(element(name).value);
}

// Offer labels, keeping the one chosen before if it is still there.
function offer(name, labels) {
  const select = element(name);
  if (labels.join() === Array.from(select.options, option => option.text).join()) return;
  const before = select.selectedOptions[0]?.text;
  select.replaceChildren(...labels.map((label, i) => new Option(label, i)));
  select.selectedIndex = Math.max(0, labels.indexOf(before));
  select.disabled = labels.length < 2;
}

function choose() {
  const split = data.splits[chosen("split")];
  offer("scene", split.scenes.map(scene => scene.label));
  const scene = split.scenes[chosen("scene")];
  offer("added", scene.tables.map(table => table.added ?? "none"));
  const [user, variant, added] = ["user", "variant", "added"].map(chosen);
  const repairs = added === 0 ? scene.repairs[user] : undefined;
  offer("start", ["nowhere", ...(repairs?.starts ?? []).map(number => `start ${number + 1}`)]);
  shown = { table: scene.tables[added], user, variant, ascent: null };
  const start = chosen("start") - 1;
  element("step").disabled = start < 0;
  if (start >= 0) shown.ascent = ascent(repairs, variant, start);
}

// One repair: its control points and P(valid) at each.
function ascent(repairs, variant, start) {
  const packed = repairs.ascents[variant];
  const p = bytes(packed.p);
  const coordinates = new DataView(bytes(packed.z).buffer);
  const length = p.length / repairs.starts.length;
  const points = Array.from({ length }, (_, i) =>
    [0, 1].map(k => coordinates.getInt16(2 * (2 * (start * length + i) + k), true) * data.unit));
  return { points, p: [...p.slice(start * length, (start + 1) * length)].map(byte => byte / 255) };
}

// Drawing

// The outline of everything within `margin` of an item's footprint.
function outline(item, margin, style) {
  const [[ax, ay], [bx, by]] = item.ends;
  const radius = item.radius + margin;
  const bearing = Math.atan2(by - ay, bx - ax);
  const [nx, ny] = [-radius * Math.sin(bearing), radius * Math.cos(bearing)];
  const arc = `A${radius} ${radius} 0 0 1`;
  return line(`M${ax + nx} ${ay + ny}${arc} ${ax - nx} ${ay - ny}L${bx - nx} ${by - ny}${arc} ${bx + nx} ${by + ny}Z`, style);
}

function line(path, style) {
  return `<path d="${path}" class="rim ${style}-rim"/><path d="${path}" class="${style}"/>`;
}

function through(points) {
  return `M${points.map(p => p.join(" ")).join("L")}`;
}

function bezier(z) {
  const [from, to] = data.ends;
  return `M${from.join(" ")}Q${z.join(" ")} ${to.join(" ")}`;
}

function drawTable(met, valid) {
  const svg = element("table");
  const picture = svg.querySelector("image");
  if (picture.getAttribute("href") !== shown.table.picture) picture.setAttribute("href", shown.table.picture);
  const parts = met.map(({ item, margin }, i) =>
    outline(item, 0, i === 0 ? "near" : "item") + (margin === null ? "" : outline(item, margin, "margin")));
  const [{ item, point, distance }] = met;
  if (distance > 0) {
    const axis = onAxis(item, point);
    const share = distance / (distance + item.radius);
    const edge = [0, 1].map(k => point[k] + share * (axis[k] - point[k]));
    parts.push(line(through([point, edge]), "gap"));
  }
  if (shown.ascent) parts.push(line(bezier(shown.ascent.points[0]), "start"));
  parts.push(line(bezier(z), valid ? "valid" : "invalid"));
  const [[ax, ay], [bx, by]] = data.ends;
  parts.push(`<circle cx="${ax}" cy="${ay}" r=".016" class="end"/>`);
  parts.push(`<rect x="${bx - 0.014}" y="${by - 0.014}" width=".028" height=".028" class="end"/>`);
  svg.querySelector("g").innerHTML = parts.join("");
}

// P(valid) as bytes, over the table's frame, with the control point and the way a repair took to it.
function drawMap(name, values) {
  const map = element(name);
  const pixels = new ImageData(data.side, data.side);
  values.forEach((value, i) => {
    const row = data.side - 1 - Math.floor(i / data.side);
    pixels.data.set([...palette.slice(3 * value, 3 * value + 3), 255], 4 * (row * data.side + (i % data.side)));
  });
  map.querySelector("canvas").getContext("2d").putImageData(pixels, 0, 0);
  const trace = shown.ascent ? line(through(shown.ascent.points.slice(0, chosen("step") + 1)), "start") : "";
  const mark = `<circle cx="${z[0]}" cy="${z[1]}" r=".035" class="mark"/>`;
  map.querySelector("g").innerHTML = `<path d="M0 0H1V1H0Z" class="frame"/>${trace}${mark}`;
}

// Words

function cm(length) {
  return `${(100 * length).toFixed(1)}\u00a0cm`;
}

function near({ item, distance }) {
  return `${cm(Math.abs(distance))} ${distance < 0 ? "into" : "from"} the ${item.symbol}`;
}

function against({ item, distance, margin, room }) {
  const hardly = cm(distance) === cm(margin) ? `just ${room > 0 ? "over" : "under"} ` : "";
  return `${hardly}${near({ item, distance })}, this user keeps ${cm(margin)}`;
}

function sentence(p, met, valid) {
  const [first] = met;
  const nearest = met.reduce((one, other) => (other.distance < one.distance ? other : one));
  const truth = valid ? "valid" : "invalid";
  const why = first.margin === null ? "nothing here matters to this user" : against(first);
  const rest = nearest.margin === null ? ` Nearest: ${near(nearest)}, which does not matter to this user.` : "";
  const step = shown.ascent ? `Step ${chosen("step")} of ${shown.ascent.points.length - 1}: ` : "";
  return `${step}P(valid) ${p.toFixed(2)} by ${data.variants[shown.variant].phrase}; in truth ${truth}: ${why}.${rest}`;
}

function percent(values, test) {
  return `${((100 * values.filter(test).length) / values.length).toFixed(1)}\u00a0%`;
}

// The whole

function cellOf(coordinate) {
  return Math.min(Math.max(Math.floor((coordinate - data.low) / cell), 0), data.side - 1);
}

function middle(i) {
  return data.low + (i + 0.5) * cell;
}

function show() {
  const { table, user, variant, ascent } = shown;
  const believed = bytes(table.maps[user][variant]);
  const bits = bytes(table.truth[user]);
  const truth = believed.map((_, i) => ((bits[i >> 3] >> (7 - (i & 7))) & 1) * 255);
  if (ascent) {
    element("step").max = ascent.points.length - 1;
    z = ascent.points[chosen("step")];
  }
  const met = encounters(table, data.users[user], z);
  const valid = met.every(({ room }) => room > 0);
  const p = ascent ? ascent.p[chosen("step")] : believed[cellOf(z[1]) * data.side + cellOf(z[0])] / 255;
  drawTable(met, valid);
  drawMap("believed", believed);
  drawMap("true", truth);
  const right = percent(believed, (value, i) => value > 127 === truth[i] > 127);
  element("believed-text").textContent = `What ${data.variants[variant].phrase} believes: right at ${right} of the points.`;
  element("true-text").textContent = `What is true: ${percent(truth, value => value > 0)} of the points make a valid path.`;
  element("state").textContent = sentence(p, met, valid);
}

// Put the control point into the middle of a cell, which ends a repair.
function move(column, row) {
  z = [column, row].map(i => middle(Math.min(Math.max(i, 0), data.side - 1)));
  element("start").value = 0;
  choose();
  show();
}

const DIRECTIONS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] };

function press(event) {
  const direction = DIRECTIONS[event.key];
  if (!direction || event.altKey || event.ctrlKey || event.metaKey) return;
  event.preventDefault();
  const cells = event.shiftKey ? 5 : 1;
  move(cellOf(z[0]) + cells * direction[0], cellOf(z[1]) + cells * direction[1]);
}

function point(event) {
  if (event.buttons !== 1) return;
  const box = event.currentTarget.getBoundingClientRect();
  const share = [(event.clientX - box.left) / box.width, 1 - (event.clientY - box.top) / box.height];
  move(...share.map(part => Math.floor(part * data.side)));
}

function begin() {
  const panel = document.getElementById("panel");
  offer("split", data.splits.map(split => split.label));
  offer("user", data.users.map(user => user.name));
  offer("variant", data.variants.map(variant => variant.label));
  element("split").selectedIndex = data.splits.findIndex(split => split.scenes.some(scene => scene.tables.length > 1));
  const stops = Array.from({ length: 9 }, (_, i) => `rgb(${palette.slice(3 * Math.round(i * 31.875)).slice(0, 3)})`);
  element("bar").style.background = `linear-gradient(to right, ${stops})`;
  panel.addEventListener("input", event => {
    if (event.target === element("start")) element("step").value = 0;
    choose();
    show();
  });
  panel.addEventListener("submit", event => event.preventDefault());
  for (const name of ["believed", "true"]) {
    element(name).addEventListener("pointerdown", event => {
      event.preventDefault();
      event.currentTarget.setPointerCapture(event.pointerId);
      element("believed").focus({ preventScroll: true });
      point(event);
    });
    element(name).addEventListener("pointermove", point);
  }
  element("believed").addEventListener("keydown", press);
  choose();
  panel.hidden = false;
  element("without").hidden = true;
  show();
}

begin();
