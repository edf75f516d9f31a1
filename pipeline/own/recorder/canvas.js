// A picture with a canvas over it: turns pointer and keys into presses, moves and releases of a tool, in pixels of the picture.
const SPEED = 0.25; // of the cross under the arrow keys, in widths of the picture a second
const SLOW = 0.2; // with Shift
const LONGEST_FRAME_MS = 50; // a busy machine slows the cross down rather than let it jump
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class Board {
  constructor(image, canvas) {
    this.image = image;
    this.canvas = canvas;
    this.tool = null; // {press, move, release, cancel, draw, continuous}
    this.layers = []; // functions (context, unit) that draw; unit: pixels of the picture for one on the screen
    this.cross = null; // place of the keyboard's cross
    this.held = new Set();
    this.pointer = null;
    new ResizeObserver(() => this.redraw()).observe(canvas);
    canvas.addEventListener("pointerdown", event => this.pointerDown(event));
    canvas.addEventListener("pointermove", event => this.pointerMove(event));
    canvas.addEventListener("pointerup", event => this.pointerUp(event));
    canvas.addEventListener("pointercancel", () => this.stop());
    canvas.addEventListener("keydown", event => this.keyDown(event));
    canvas.addEventListener("keyup", event => this.held.delete(event.key));
    canvas.addEventListener("blur", () => { this.held.clear(); this.cross = null; this.redraw(); });
  }

  async show(url, alt) {
    this.stop();
    this.cross = null;
    this.image.alt = alt;
    this.image.src = url;
    await this.image.decode().catch(() => {}); // another picture was asked for meanwhile
    this.image.parentElement.style.setProperty("--ratio", this.image.naturalWidth / this.image.naturalHeight);
    this.redraw();
  }

  stop() { // a drag that the system or another tool ended
    this.pointer = null;
    this.tool?.cancel();
    this.redraw();
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * this.image.naturalWidth;
    return [x, ((event.clientY - box.top) / box.height) * this.image.naturalHeight];
  }

  pointerDown(event) {
    if (!event.isPrimary || event.button !== 0 || !this.tool) return;
    event.preventDefault();
    this.canvas.focus({ preventScroll: true });
    this.cross = null;
    this.pointer = event.pointerId;
    this.canvas.setPointerCapture(event.pointerId);
    this.tool.press(this.place(event), event.timeStamp);
    this.redraw();
  }

  pointerMove(event) {
    if (event.pointerId !== this.pointer) return;
    const events = event.getCoalescedEvents?.() ?? [];
    for (const one of events.length ? events : [event]) this.tool.move(this.place(one), one.timeStamp);
    this.redraw();
  }

  pointerUp(event) {
    if (event.pointerId !== this.pointer) return;
    this.pointer = null;
    this.tool.release(this.place(event), event.timeStamp);
    this.redraw();
  }

  keyDown(event) {
    if (!this.tool || event.ctrlKey || event.altKey || event.metaKey) return;
    const { key } = event;
    if (key in STEPS) {
      this.cross ??= [this.image.naturalWidth / 2, this.image.naturalHeight / 2];
      this.slow = event.shiftKey;
      if (!this.held.size) this.glide();
      this.held.add(key);
    } else if (key === "Enter" || key === " ") {
      if (event.repeat) return;
      this.cross ??= [this.image.naturalWidth / 2, this.image.naturalHeight / 2];
      const begins = !(this.tool.continuous && this.tool.busy);
      if (begins) this.tool.press([...this.cross], event.timeStamp);
      if (!begins || !this.tool.continuous) this.tool.release([...this.cross], event.timeStamp);
    } else if (key === "Escape") {
      this.tool.cancel();
    } else return;
    event.preventDefault();
    this.redraw();
  }

  glide() { // moves the cross while arrow keys are held
    let before = performance.now();
    const frame = now => {
      if (!this.held.size || !this.cross) return;
      const step = (Math.min(Math.max(now - before, 0), LONGEST_FRAME_MS) / 1000) * SPEED * (this.slow ? SLOW : 1) * this.image.naturalWidth;
      before = now;
      for (const key of this.held) STEPS[key].forEach((sign, axis) => { this.cross[axis] += sign * step; });
      this.cross[0] = Math.min(Math.max(this.cross[0], 0), this.image.naturalWidth);
      this.cross[1] = Math.min(Math.max(this.cross[1], 0), this.image.naturalHeight);
      this.tool?.move([...this.cross], now);
      this.redraw();
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  redraw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.paint();
    });
  }

  paint() {
    const { canvas, image } = this;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    if (!image.naturalWidth || !canvas.width) return;
    const context = canvas.getContext("2d");
    const scale = canvas.width / image.naturalWidth;
    context.setTransform(scale, 0, 0, canvas.height / image.naturalHeight, 0, 0);
    const unit = ratio / scale;
    for (const layer of this.layers) layer(context, unit);
    this.tool?.draw(context, unit);
    if (this.cross) {
      const [x, y] = this.cross;
      stroke(context, unit, [[x - 12 * unit, y], [x + 12 * unit, y]], "#ffffff");
      stroke(context, unit, [[x, y - 12 * unit], [x, y + 12 * unit]], "#ffffff");
    }
  }
}

export function stroke(context, unit, points, colour, { dashed = false, closed = false, width = 3, alpha = 1 } = {}) {
  if (!points.length) return;
  context.save();
  context.globalAlpha = alpha;
  context.lineJoin = context.lineCap = "round";
  context.beginPath();
  points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  if (closed) context.closePath();
  context.lineWidth = (width + 2.5) * unit; // a dark rim: seen on any picture
  context.strokeStyle = "#111417";
  context.stroke();
  context.lineWidth = width * unit;
  context.strokeStyle = dashed ? "#ffffff" : colour;
  context.stroke();
  if (dashed) {
    context.lineCap = "butt";
    context.setLineDash([9 * unit, 5 * unit]);
    context.strokeStyle = colour;
    context.stroke();
  }
  context.restore();
}

export function dot(context, unit, [x, y], colour, radius = 5) {
  context.beginPath();
  context.arc(x, y, radius * unit, 0, 2 * Math.PI);
  context.fillStyle = colour;
  context.fill();
  context.lineWidth = 2 * unit;
  context.strokeStyle = "#111417";
  context.stroke();
}

export function write(context, unit, text, [x, y]) {
  context.font = `600 ${15 * unit}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineJoin = "round";
  context.lineWidth = 4 * unit;
  context.strokeStyle = "#111417";
  context.strokeText(text, x, y);
  context.fillStyle = "#ffffff";
  context.fillText(text, x, y);
}
