// What a person does on the picture: draw a path, or mark points.
import { dot, stroke } from "/static/canvas.js";

export class PathTool {
  continuous = true;

  constructor(current, say, changed) { // `current` returns {scene, overview}
    Object.assign(this, { current, say, changed });
    this.samples = []; // [t in ms, column, row]
    this.state = "empty"; // empty, drawing, drawn, refused
  }

  get busy() { return this.state === "drawing"; }

  home() { return [...this.current().scene.ends.start]; }

  isOff(point, place) { // the distance [m] from start or goal if it is too large, else 0
    const { scene, overview } = this.current();
    const [x, y] = metres(scene.matrix, point);
    const distance = Math.hypot(x - overview[place][0], y - overview[place][1]);
    return distance <= overview.ends_within_m ? 0 : distance;
  }

  press(point, t) {
    const off = this.isOff(point, "start");
    if (off) {
      const rest = this.state === "drawn" ? " The drawn path waits for your judgement." : "";
      this.say(`Begin inside the circle at Start: that was ${cm(off)} away.${rest}`, "bad");
      return;
    }
    this.samples = [[t, ...point]];
    this.turn("drawing");
    this.say("Draw to the goal, and let go inside its circle.");
  }

  move(point, t) {
    if (this.state === "drawing") this.samples.push([t, ...point]);
  }

  release(point, t) {
    if (this.state !== "drawing") return;
    this.samples.push([t, ...point]);
    const off = this.isOff(point, "goal");
    if (off) this.refuse(`The path ends ${cm(off)} from the goal: it is not stored. Draw it again.`);
    else if (this.samples.length < this.current().overview.min_samples) this.refuse("That was too quick for a path. Draw it slower.");
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
    if (this.state === "drawing" || this.state === "drawn") this.say("Discarded. Draw another path from Start to Goal.");
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

export class PointTool {
  continuous = false;
  busy = false;

  constructor(count, done, changed) { // `done` gets the points once there are `count`
    Object.assign(this, { count, done, changed });
    this.points = [];
  }

  home() { return null; }

  press(point) {
    if (this.points.length === this.count) this.points = [];
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
    if (this.points.length === this.count) this.done(this.points);
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

export function metres(homography, [x, y]) {
  const [u, v, w] = homography.map(([a, b, c]) => a * x + b * y + c);
  return w > 0 ? [u / w, v / w] : [Infinity, Infinity]; // beyond the horizon
}

function cm(length) {
  return Number.isFinite(length) ? `${Math.round(100 * length)} cm` : "far";
}
