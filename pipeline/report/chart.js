// In the SVG of a chart: a value is shown under the pointer, an entry of the legend hides its series.
const svg = document.documentElement;
const make = (name, parent) => parent.appendChild(document.createElementNS("http://www.w3.org/2000/svg", name));
const tip = make("g", svg);
const box = make("rect", tip);
const words = make("text", tip);
tip.setAttribute("class", "tip");

// Set attributes of an element; and enlarge what a pointer meets by a margin around it.
const set = (element, values) => Object.entries(values).forEach(([name, value]) => element.setAttribute(name, value));
function enlarge(part, margin) {
  const { x, y, width, height } = part.getBBox();
  const target = { x: x - margin, y: y - margin, width: width + 2 * margin, height: height + 2 * margin };
  set(make("rect", part), { ...target, fill: "none", "pointer-events": "all" });
}

for (const mark of svg.querySelectorAll(".series:has(> title)")) {
  const title = mark.querySelector("title");
  const text = title.textContent;
  title.remove(); // else the browser shows it a second time
  set(mark, { role: "img", "aria-label": text });
  enlarge(mark, 3);
  mark.addEventListener("pointerenter", () => {
    words.textContent = text;
    tip.style.display = "block";
    const at = mark.getBBox();
    const size = words.getBBox();
    const { width } = svg.viewBox.baseVal;
    const x = Math.min(Math.max(at.x + at.width / 2 - size.width / 2, 8), width - size.width - 8);
    const y = at.y > 34 ? at.y - 12 : at.y + at.height + 22;
    set(words, { x, y });
    set(box, { x: x - 6, y: y - 14, width: size.width + 12, height: 20 });
  });
  mark.addEventListener("pointerleave", () => (tip.style.display = "none"));
}

for (const toggle of svg.querySelectorAll(".toggle")) {
  set(toggle, { role: "button", tabindex: 0, "aria-pressed": true });
  enlarge(toggle, 2);
  const act = () => {
    const shown = toggle.getAttribute("aria-pressed") !== "true";
    toggle.setAttribute("aria-pressed", shown);
    for (const part of svg.querySelectorAll(`.series[data-series="${toggle.dataset.series}"]`)) part.style.display = shown ? "" : "none";
  };
  toggle.addEventListener("click", act);
  toggle.addEventListener("keydown", event => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    act();
  });
}
