// The recorder's page: shows scenes, sends what a person draws and judges, and says what is recorded.
import { Board, stroke } from "/static/canvas.js";
import { $, ask, element, say } from "/static/talk.js";
import { OutlineTool, PathTool, PointTool } from "/static/tools.js";

const STEPS = { table: "Place the table", items: "Outline items", paths: "Record paths" };
const CORNERS = ["far left", "far right", "near right", "near left"];
export const board = new Board($("picture"), $("canvas"));
let overview = null; // what is recorded, from the server
let scene = null; // what stands over the current picture, from the server
let step = "paths";
let user = "";
let sending = false;
let opened = 0; // counts the scenes that were asked for

// ---- talk to the person

async function attempt(action) { // an action whose error is shown
  try {
    await action();
  } catch (error) {
    say(error.message, "bad");
  }
}

async function refresh() {
  overview = await ask("/api/overview");
  document.documentElement.style.setProperty("--valid", overview.colours.valid);
  document.documentElement.style.setProperty("--invalid", overview.colours.invalid);
  const before = localStorage.getItem(`user of ${overview.folder}`);
  if (!user && before) added.push(user = before);
  if (!allUsers().includes(user)) user = overview.users.length === 1 ? overview.users[0] : ""; // of several, nobody is guessed
  if (scene && overview.scenes.includes(scene.name)) {
    const answer = await ask(sceneUrl("/api/scenes/", scene.name));
    if (scene.name === answer.name) scene = answer;
  }
  showCounts();
  showUsers();
  board.redraw();
}

const sceneUrl = (prefix, name) => prefix + encodeURIComponent(name);

// ---- where we are: #paths/kitchen

async function go() {
  const [asked, name] = location.hash.slice(1).split("/").map(decodeURIComponent);
  step = asked in STEPS ? asked : "paths";
  document.querySelectorAll(".pages a").forEach(link => {
    if (link.hash === `#${step}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  });
  document.querySelector("h1").textContent = STEPS[step];
  document.title = `${STEPS[step]} – Causal specifications`;
  for (const name in STEPS) document.querySelectorAll(`.${name}-only`).forEach(part => { part.hidden = step !== name; });
  $("board").hidden = false;
  $("next").firstChild.textContent = step === "paths" ? "Skip" : "Next";
  await open(overview.scenes.includes(name) ? name : scene?.name ?? firstOpenScene());
}

const toJudge = () => overview.scenes.find(name => Object.values(overview.counts[name] ?? {}).some(count => count.unjudged));

function firstOpenScene() { // the first to judge, or without a path of this person, so that one goes on where one stopped
  return toJudge() ?? overview.scenes.find(name => !overview.counts[name]?.[user]) ?? overview.scenes[0];
}

async function open(name) {
  board.tool = null;
  showButtons();
  const request = ++opened;
  const answer = await ask(sceneUrl("/api/scenes/", name));
  if (request !== opened) return; // the person has gone on
  scene = answer;
  const index = overview.scenes.indexOf(name);
  $("scene-title").textContent = `Scene ${index + 1} of ${overview.scenes.length}: ${name}`;
  $("back").disabled = index === 0;
  $("next").disabled = index === overview.scenes.length - 1;
  await board.show(sceneUrl("/pictures/", name), `Scene ${name}`);
  if (request !== opened) return;
  start();
  showCounts();
}

function turn(by) {
  const name = overview.scenes[overview.scenes.indexOf(scene.name) + by];
  if (name !== undefined && mayLeave()) location.hash = `${step}/${encodeURIComponent(name)}`;
}

const waiting = () => board.tool instanceof PathTool && board.tool.state === "drawn";

function mayLeave() {
  return !waiting() || confirm("The drawn path has not been judged. Leave it?");
}

// ---- what can be done on this step's picture

function start() {
  board.tool = null;
  if (step === "table") startTable();
  else if (step === "items") attempt(startItems);
  else if (!scene.corners) say("The recorder does not know where the table is in this picture. Mark its corners first, under Table.", "bad");
  else startPaths();
  showButtons();
  board.redraw();
}

const unjudged = () => (step === "paths" && scene?.paths.filter(path => path.valid === null)) || [];

function startPaths() {
  board.tool = new PathTool(overview.min_samples, say, showButtons);
  say(user ? `Draw a path for ${user}: press where it begins, let go where it ends.` : "Say who judges, then draw a path.");
  tellUnjudged();
}

function tellUnjudged() {
  const [first, ...rest] = unjudged();
  if (first) say(`A stored path of ${first.user} waits, yellow: is it valid? ${rest.length ? `${rest.length} more after it.` : ""}`);
}

async function judgeStored(path, valid) {
  sending = true;
  await attempt(async () => {
    await ask("/api/judge", { id: path.id, valid });
    await refresh();
    say(`Stored: path ${path.demo} of ${path.user}, ${valid ? "valid" : "not valid"}.`, "good");
    const next = toJudge(); // in another scene
    if (!unjudged().length && next) location.hash = `paths/${encodeURIComponent(next)}`;
    tellUnjudged();
  });
  sending = false;
  showButtons();
}

async function judge(valid) {
  const tool = board.tool;
  if (sending || !tool) return; // the picture is not there yet
  if (!waiting()) {
    if (unjudged().length) await judgeStored(unjudged()[0], valid);
    return;
  }
  if (!user) {
    say("Say first who judges: choose or add a name.", "bad");
    (document.querySelector("#users input") ?? $("user-name")).focus();
    return;
  }
  sending = true;
  showButtons();
  await attempt(async () => {
    const stored = await ask("/api/paths", { scene: scene.name, user, valid, samples: tool.samples });
    tool.clear();
    say(`Stored: path ${stored.demo} of ${user} in this scene, ${valid ? "valid" : "not valid"}.`, "good");
    await refresh();
  });
  sending = false;
  showButtons();
}

async function undo() {
  const last = ownPaths().at(-1);
  if (!last || sending || !board.tool) return;
  await attempt(async () => {
    await ask("/api/remove", { id: last.id });
    say(`Removed path ${last.demo} of ${user}.`);
  });
  await attempt(refresh);
  showButtons();
}

const ownPaths = () => scene?.paths.filter(path => path.user === user && path.valid !== null) ?? [];

function showButtons() {
  const drawn = waiting() && !sending;
  $("discard").disabled = !drawn;
  for (const id of ["valid", "invalid"]) $(id).disabled = !drawn && (sending || !unjudged().length);
  $("undo").disabled = sending || !board.tool || !ownPaths().length;
}

// ---- outlines of items

let storing = Promise.resolve(); // changes are stored one after the other

async function startItems() {
  const name = scene.name;
  const { items, told, kinds, elsewhere } = await ask(sceneUrl("/api/items/", name));
  if (scene.name !== name || step !== "items") return;
  if (elsewhere) {
    $("counted").textContent = $("kind").value = "";
    for (const id of ["accept", "delete", "undo-items"]) $(id).disabled = true;
    return say(`${elsewhere} tells what stands here: change it there.`);
  }
  showKinds(kinds);
  const tool = new OutlineTool({ items, told, found: [], propose: (point, edge) => attempt(() => outline(tool, name, point, edge)), changed: () => store(tool, name) });
  board.tool = tool;
  showItem(tool);
  say("Looking for items …");
  board.redraw();
  await attempt(async () => {
    const { found } = await ask(sceneUrl("/api/found/", name));
    tool.found = found.filter(one => !tool.items.some(item => overlap(item.points, one.points)));
    const more = `${tool.found.length} items found, broken outlines: click to accept, or A for all. Click what is missing.`;
    if (board.tool === tool) say(tool.found.length ? more : "No other items found. Click what is missing.");
  });
  showItem(tool);
  board.redraw();
}

async function outline(tool, name, point, edge) {
  const { points } = await ask("/api/propose", { scene: name, point, edge });
  const like = tool.found.find(one => overlap(one.points, points));
  tool.add({ kind: like?.kind ?? $("kind").value.trim(), points });
  await store(tool, name);
}

function store(tool, name) {
  const { items, isTold } = tool;
  storing = storing.then(() => attempt(async () => {
    await ask("/api/items", { scene: name, told: isTold, kinds: items.map(item => item.kind), outlines: items.map(item => item.points) });
    showKinds((await ask(sceneUrl("/api/items/", name))).kinds);
    say(`Stored: ${items.length} ${items.length === 1 ? "item" : "items"} in this scene.`, "good");
  }));
  showItem(tool);
  board.redraw();
  return storing;
}

function acceptAll(tool) {
  if (!tool.found.length) return;
  tool.add(...tool.found.splice(0));
  store(tool, scene.name);
}

function showItem(tool) {
  if (board.tool !== tool) return; // the person has gone on
  const item = tool.items[tool.chosen];
  if (item && document.activeElement !== $("kind")) $("kind").value = item.kind;
  $("delete").disabled = !item;
  $("undo-items").disabled = !tool.history.length;
  $("accept").disabled = !tool.found.length;
  const none = tool.isTold ? "Told to be a table without items." : "Nothing is outlined: the detector decides what stands here.";
  $("counted").textContent = tool.items.length ? `${tool.items.length} outlined: the models see these alone in this scene.` : none;
}

const showKinds = kinds => $("kinds").replaceChildren(...kinds.map(kind => element("option", null, { value: kind })));

function overlap(first, second) { // whether the middle of one lies in the box of the other
  const box = points => [0, 1].map(axis => points.map(point => point[axis])).map(values => [Math.min(...values), Math.max(...values)]);
  const [[left, right], [top, bottom]] = box(first);
  const [[a, b], [c, d]] = box(second);
  return (a + b) / 2 > left && (a + b) / 2 < right && (c + d) / 2 > top && (c + d) / 2 < bottom;
}

function startTable() {
  const form = $("table-form").elements;
  ["width", "depth"].forEach((side, i) => { $(side).value = overview.size_m[i]; });
  form.holds.value = overview.for_each_scene ? "one" : "all";
  const paths = Object.values(overview.counts).flatMap(Object.values).reduce((sum, count) => sum + count.valid + count.invalid + count.unjudged, 0);
  $("kept").textContent = paths ? `${paths} paths are stored in metres of the table as it was. Moving it now does not move them.` : "";
  board.tool = new PointTool(tellCorner);
  tellCorner();
  board.redraw();
}

function tellCorner() {
  const index = board.tool.points.length;
  if (index === 4) say("All four corners are marked. Save the table, or click to begin anew.");
  else say(`Mark the ${CORNERS[index]} corner of the table${index ? "" : scene.corners ? ", to place the table anew" : ""}.`);
}

async function saveTable() {
  const form = $("table-form").elements;
  const points = board.tool?.points ?? [];
  if (points.length % 4) {
    say(`${points.length} of four corners are marked: mark the others, too, or press Escape on the picture.`, "bad");
    return;
  }
  const number = id => $(id).valueAsNumber;
  await attempt(async () => {
    await ask("/api/table", {
      scene: scene.name,
      everywhere: form.holds.value === "all",
      corners: points.length ? points : null,
      size_m: [number("width"), number("depth")],
    });
    await refresh();
    start();
    say("The table is stored. The grid over the picture has ten fields a side: does it fit?", "good");
  });
}

// ---- what stands over the picture

function drawScene(context, unit) {
  if (!scene?.corners) return;
  if (step === "table") for (const line of scene.grid) stroke(context, unit, line, "#ffffff", { width: 0.75, alpha: 0.5 });
  stroke(context, unit, scene.corners, "#ffffff", { closed: true, width: 1.5, alpha: 0.8 });
  if (unjudged().length) stroke(context, unit, unjudged()[0].points, "#f0e442");
  if (step === "paths" && $("earlier").checked) for (const path of ownPaths())
    stroke(context, unit, path.points, overview.colours[path.valid ? "valid" : "invalid"], { dashed: !path.valid, alpha: 0.75, width: 2.5 });
}

// ---- lists

const added = []; // names that were typed and may have no path yet
const allUsers = () => [...new Set([...(overview?.users ?? []), ...added])];

function showUsers() {
  $("users").replaceChildren(...allUsers().map(name => {
    const label = element("label", null, { class: "check" });
    const radio = element("input", null, { type: "radio", name: "user", value: name });
    radio.checked = name === user;
    radio.addEventListener("change", () => choose(name));
    label.append(radio, element("span", name));
    return label;
  }));
  if (!allUsers().length) $("users").append(element("p", "Nobody yet: add a name.", { class: "note" }));
}

function choose(name) {
  user = name;
  localStorage.setItem(`user of ${overview.folder}`, name);
  showUsers();
  showButtons();
  if (waiting()) say(`Is it valid for ${user}?`);
  else if (scene?.corners && step === "paths") say(`Draw a path for ${user}.`);
  board.redraw();
}

function showCounts() {
  const users = overview.users;
  const number = count => (count ? `${count.valid} + ${count.invalid}${count.unjudged ? `, ${count.unjudged} to judge` : ""}` : "–");
  const head = element("tr", null);
  head.append(element("th", "Scene", { scope: "col" }));
  for (const name of users) head.append(element("th", name, { scope: "col" }));
  const rows = overview.scenes.map(name => {
    const row = element("tr", null);
    const title = element("th", null, { scope: "row" });
    const link = element("a", name, { href: `#${step}/${encodeURIComponent(name)}` });
    if (name === scene?.name) link.setAttribute("aria-current", "true");
    title.append(link);
    row.append(title, ...users.map(person => element("td", number(overview.counts[name]?.[person]))));
    return row;
  });
  const table = document.querySelector("#recorded table");
  table.tHead.replaceChildren(head);
  table.tBodies[0].replaceChildren(...rows);
  $("missing").replaceChildren(...users.map(missing).filter(Boolean).map(text => element("li", text)));
  $("where").textContent = `Everything is stored in the folder ${overview.folder} on this machine, as soon as you judge it.`;
}

function missing(person) { // what a report about this person needs, still
  const counts = Object.values(overview.counts).map(users => users[person]).filter(Boolean);
  const needs = [];
  const more = overview.min_scenes - counts.length;
  if (more > 0) needs.push(`paths in ${more} more ${more === 1 ? "scene" : "scenes"}`);
  if (!counts.some(count => count.valid)) needs.push("valid paths");
  if (!counts.some(count => count.invalid)) needs.push("paths that are not valid");
  return needs.length ? `A report about ${person} still needs ${needs.join(" and ")}.` : "";
}

// ---- wiring

board.layers = [drawScene];
const onItems = action => () => { if (board.tool instanceof OutlineTool) action(board.tool); };
$("accept").addEventListener("click", onItems(acceptAll));
$("delete").addEventListener("click", onItems(tool => tool.remove()));
$("undo-items").addEventListener("click", onItems(tool => tool.undo()));
$("items-form").addEventListener("submit", event => { event.preventDefault(); $("canvas").focus(); });
$("kind").addEventListener("change", onItems(tool => tool.name($("kind").value.trim())));
$("back").addEventListener("click", () => turn(-1));
$("next").addEventListener("click", () => turn(1));
$("valid").addEventListener("click", () => judge(true));
$("invalid").addEventListener("click", () => judge(false));
$("discard").addEventListener("click", () => board.stop());
$("undo").addEventListener("click", undo);
$("earlier").addEventListener("change", () => board.redraw());
$("user-form").addEventListener("submit", event => {
  event.preventDefault();
  const name = $("user-name").value.normalize("NFC").trim().split(/\s+/).join(" ");
  if (!name) return;
  added.push(name);
  $("user-name").value = "";
  choose(name);
  $("canvas").focus();
});
$("table-form").addEventListener("submit", event => { event.preventDefault(); saveTable(); });
$("board").addEventListener("keydown", event => { // letters act on the picture and its buttons, never in a field
  if (event.target.matches("input:not([type=radio], [type=checkbox])") || event.ctrlKey || event.metaKey || event.altKey) return;
  const keys = { s: () => turn(1), b: () => turn(-1) };
  if (step === "items") Object.assign(keys, { a: onItems(acceptAll), d: onItems(tool => tool.remove()), u: onItems(tool => tool.undo()), k: () => $("kind").focus() });
  if (step === "paths") Object.assign(keys, { v: () => judge(true), n: () => judge(false), u: undo });
  const action = keys[event.key.toLowerCase()];
  if (!action || event.repeat) return;
  event.preventDefault();
  action();
});
document.addEventListener("click", event => { if (event.target.closest('a[href^="#"]:not(.skip)') && !mayLeave()) event.preventDefault(); });
window.addEventListener("beforeunload", event => { if (waiting()) event.preventDefault(); });
window.addEventListener("focus", () => { if (overview && !waiting() && !sending) attempt(refresh); }); // another tab may have stored
window.addEventListener("hashchange", () => { if (location.hash !== "#main") attempt(async () => { await refresh(); await go(); }); });
attempt(async () => { await refresh(); await go(); }).then(() => document.body.setAttribute("aria-busy", "false"));
