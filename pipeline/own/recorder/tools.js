// What a person does on the picture: draw a path, or mark points.
import { dot, stroke, write } from "/static/canvas.js";

export class PathTool {
  continuous = true;

  constructor(least, say, changed) { // `least`: samples of a path
    Object.assign(this, { least, say, changed });
    this.samples = []; // [t in ms, column, row]
    this.state = "empty"; // empty, drawing, drawn, refused
  }

  get busy() { return this.state === "drawing"; }

  press(point, t) {
    this.samples = [[t, ...point]];
    this.turn("drawing");
    this.say("Let go where the path ends.");
  }

  move(point, t) {
    if (this.state === "drawing") this.samples.push([t, ...point]);
  }

  release(point, t) {
    if (this.state !== "drawing") return;
    this.samples.push([t, ...point]);
    if (this.samples.length < this.least) this.refuse("That was too quick for a path. Draw it slower.");
    else {
      this.turn("drawn");
      const seconds = (this.samples.at(-1)[0] - this.samples[0][0]) / 1000;
      this.say(`Drawn in ${seconds.toFixed(1)} s. Is it valid?`);
    }
  }

  refuse(sentence) {
    this.turn("refused");
    this.say(sentence, "bad");
  }

  cancel() {
    if (this.state === "drawing" || this.state === "drawn") this.say("Discarded. Draw another path.");
    this.clear();
  }

  clear() {
    this.samples = [];
    this.turn("empty");
  }

  turn(state) {
    this.state = state;
    this.changed();
  }

  draw(context, unit) {
    const refused = this.state === "refused";
    stroke(context, unit, this.samples.map(([, x, y]) => [x, y]), refused ? "#9aa3ad" : "#f0e442", { dashed: refused });
  }
}

export class PointTool { // marks the table's four corners; `changed` is told of each
  continuous = false;
  busy = false;

  constructor(changed) {
    this.changed = changed;
    this.points = [];
  }

  press(point) {
    if (this.points.length === 4) this.points = [];
    this.points.push(point);
    this.dragging = true;
  }

  move(point) {
    if (this.dragging) this.points[this.points.length - 1] = point;
  }

  release(point) {
    if (!this.dragging) return;
    this.dragging = false;
    this.points[this.points.length - 1] = point;
    this.changed();
  }

  cancel() {
    this.dragging = false;
    this.points = [];
    this.changed();
  }

  draw(context, unit) {
    stroke(context, unit, this.points, "#f0e442", { closed: this.points.length === 4 });
    for (const point of this.points) dot(context, unit, point, "#f0e442");
  }
}

const NEAR_POINT = 9; // pixels on the screen within which a press takes an outline's point

export class OutlineTool { // outlines items: click to propose, accept or choose; drag points to correct
  continuous = false;
  busy = false;

  constructor({ items, told, found, propose, changed }) { // items, found: [{kind, points}]; told: what stands here, before; propose(point, edge) adds one
    Object.assign(this, { items, told, found, propose, changed });
    this.chosen = -1;
    this.unit = 1;
    this.history = [];
  }

  get isTold() { return this.told || this.history.length > 0; }

  keep() { this.history.push(structuredClone(this.items)); }

  press(point) {
    this.from = this.to = point;
    this.held = null;
    this.items.forEach((item, i) => item.points.forEach((place, k) => {
      if (Math.hypot(place[0] - point[0], place[1] - point[1]) < NEAR_POINT * this.unit && i === this.chosen) this.held = [i, k];
    }));
    if (this.held) this.keep();
  }

  move(point) {
    if (!this.from) return;
    this.to = point;
    if (this.held) this.items[this.held[0]].points[this.held[1]] = point;
  }

  release(point) {
    if (!this.from) return;
    const from = this.from;
    this.move(point);
    this.from = null;
    if (this.held) return this.changed();
    const dragged = Math.hypot(point[0] - from[0], point[1] - from[1]) > NEAR_POINT * this.unit;
    const own = this.items.findIndex(item => within(item.points, from));
    const found = this.found.findIndex(item => within(item.points, from));
    if (dragged || (own < 0 && found < 0)) return this.propose(from, dragged ? point : from);
    if (own >= 0) this.chosen = own;
    else this.add(this.found.splice(found, 1)[0]);
    this.changed();
  }

  add(...items) {
    this.keep();
    this.items.push(...items.map(({ kind, points }) => ({ kind, points })));
    this.chosen = this.items.length - 1;
  }

  remove() {
    if (!this.items[this.chosen]) return;
    this.keep();
    this.items.splice(this.chosen, 1);
    this.chosen = -1;
    this.changed();
  }

  name(kind) {
    if (!this.items[this.chosen]) return;
    this.keep();
    this.items[this.chosen].kind = kind;
    this.changed();
  }

  undo() {
    if (!this.history.length) return;
    this.items = this.history.pop();
    this.chosen = -1;
    this.changed();
  }

  cancel() {
    this.from = this.held = null;
    this.chosen = -1;
  }

  draw(context, unit) {
    this.unit = unit;
    for (const item of this.found) stroke(context, unit, item.points, "#9aa3ad", { closed: true, dashed: true, width: 2 });
    this.items.forEach((item, i) => {
      const chosen = i === this.chosen;
      stroke(context, unit, item.points, chosen ? "#f0e442" : "#ffffff", { closed: true, width: 2 });
      if (chosen) for (const point of item.points) dot(context, unit, point, "#f0e442", 4);
      if (item.kind) write(context, unit, item.kind, middle(item.points));
    });
    if (this.from && !this.held && this.to !== this.from) stroke(context, unit, [this.from, this.to], "#f0e442", { dashed: true });
  }
}

const middle = points => [0, 1].map(axis => points.reduce((sum, point) => sum + point[axis], 0) / points.length);

function within(points, [x, y]) {
  let inside = false;
  points.forEach(([ax, ay], i) => {
    const [bx, by] = points[(i || points.length) - 1];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  });
  return inside;
}
