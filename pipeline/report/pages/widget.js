"use strict";
// Move a path's control point over a table; see what is true and what the models state. Data: figures.widget. Lengths in m.
(async () => {
  const widget = document.querySelector(".widget");
  const data = JSON.parse(widget.querySelector("script").textContent);
  const { start, end, low, high, side, users, sources } = data;
  const step = (high - low) / side;
  const index = coordinate => Math.min(side - 1, Math.max(0, Math.floor((coordinate - low) / step)));
  const snapped = coordinate => low + (index(coordinate) + 0.5) * step;
  const svg = widget.querySelector("svg");
  const handle = svg.querySelector(".handle");
  const rows = [...widget.querySelectorAll("tbody tr")];
  const p = await greys(data.maps); // (table, user, source, y, x)
  const palette = data.palette.map(hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16)));
  let z = data.first.map(snapped); // the control point, in the middle of a square of the maps
  let table = 0;

  async function greys(uri) {
    const image = new Image();
    image.src = uri;
    await image.decode();
    const canvas = new OffscreenCanvas(image.width, image.height).getContext("2d");
    canvas.drawImage(image, 0, 0);
    return canvas.getImageData(0, 0, image.width, image.height).data.filter((_, i) => i % 4 === 0);
  }

  function colour(value) {
    const place = Math.min(value * (palette.length - 1), palette.length - 1.001);
    const [one, other] = [palette[Math.floor(place)], palette[Math.floor(place) + 1]];
    return one.map((channel, k) => channel + (place % 1) * (other[k] - channel));
  }

  function map(user, source) {
    const first = ((table * users.length + user) * sources.length + source) * side ** 2;
    return p.subarray(first, first + side ** 2);
  }

  function drawMap(canvas, values) {
    const pixels = new ImageData(side, side);
    const place = i => 4 * ((side - 1 - Math.floor(i / side)) * side + (i % side)); // rows from the bottom to the top
    values.forEach((value, i) => pixels.data.set([...colour(value / 255), 255], place(i)));
    canvas.getContext("2d").putImageData(pixels, 0, 0);
  }

  function chooseTable(number) {
    table = number;
    svg.querySelector("image").setAttribute("href", data.images[table]);
    rows.forEach((row, user) => row.querySelectorAll("canvas").forEach((canvas, source) => drawMap(canvas, map(user, source))));
    move(z);
  }

  function move(to) {
    z = to.map(snapped);
    svg.querySelectorAll(".path").forEach(path => path.setAttribute("d", `M${start}Q${z} ${end}`));
    svg.querySelector(".arms").setAttribute("d", `M${start}L${z}L${end}`);
    handle.setAttribute("transform", `translate(${z})`);
    const spoken = rows.map((row, user) => {
      const values = sources.map((_, source) => map(user, source)[index(z[1]) * side + index(z[0])] / 255);
      const verdicts = values.map(value => value > 0.5);
      row.querySelectorAll("td").forEach((cell, source) => {
        const wrong = verdicts[source] !== verdicts[0];
        const stated = `${values[source].toFixed(2)}: ${wrong ? "wrong" : "right"}`;
        cell.querySelector(".said").textContent = source > 0 ? stated : verdicts[0] ? "valid" : "not valid";
        cell.classList.toggle("wrong", wrong);
        const [dot] = cell.getElementsByClassName("dot");
        dot.style.left = `${(100 * (z[0] - low)) / (high - low)}%`;
        dot.style.top = `${(100 * (high - z[1])) / (high - low)}%`;
      });
      return `${users[user]}: ${[...row.querySelectorAll("td")].map((cell, i) => `${sources[i]} ${cell.textContent.trim()}`).join(", ")}`;
    });
    widget.querySelector("[role=status]").textContent = spoken.join(". ");
  }

  function follow(box, event) {
    const { left, top, width, height } = box.getBoundingClientRect();
    move([low + ((event.clientX - left) / width) * (high - low), high - ((event.clientY - top) / height) * (high - low)]);
  }

  for (const box of [svg, ...widget.querySelectorAll(".map")]) {
    box.addEventListener("pointerdown", event => {
      box.setPointerCapture(event.pointerId);
      follow(box, event);
    });
    box.addEventListener("pointermove", event => box.hasPointerCapture(event.pointerId) && follow(box, event));
  }
  const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  handle.addEventListener("keydown", event => {
    if (!(event.key in steps)) return;
    event.preventDefault();
    move(z.map((coordinate, k) => coordinate + (event.shiftKey ? 5 : 1) * step * steps[event.key][k]));
  });
  widget.addEventListener("change", () => {
    const chosen = [...widget.querySelectorAll("input:checked")];
    chooseTable(chosen.reduce((sum, input) => sum + Number(input.value), 0));
  });
  widget.hidden = false;
  chooseTable(0);
})();
