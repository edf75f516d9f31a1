// Shows one trial after the other and sends the answers; nothing here knows what a trial is for.
import { Board, stroke } from "/static/canvas.js";
import { $, ask, element, say } from "/static/talk.js";

const board = new Board($("picture"), $("canvas"));
let user = "";
let next = null; // what the server shows: {trial, points, picture, answered, left_s, apart, note, wanted, taken, known}
let since = 0; // when its picture was shown
let sending = false;
let shown = 0; // how many trials were shown: undo may call the next while a picture is on its way

const busy = is => document.body.setAttribute("aria-busy", is);

async function show(told) {
  const turn = ++shown;
  next = null;
  busy(true);
  $("trial").hidden = false;
  $("undo").disabled = !told.answered;
  const left = told.trial === null ? "" : `, about ${Math.ceil(told.left_s / 60)} minutes left`;
  $("count").textContent = `${told.answered} judged${left}`;
  for (const id of ["valid", "invalid"]) $(id).disabled = told.trial === null || Boolean(told.wanted);
  $("note").textContent = told.note ?? "";
  $("note").hidden = !told.note;
  $("photograph").hidden = !told.wanted && !told.taken;
  $("file").value = "";
  $("known").replaceChildren(...(told.known ?? []).map(line => element("li", line)));
  if (told.trial === null) {
    next = told;
    board.redraw();
    busy(false);
    const why = told.left_s ? "That is all." : "The minutes are over; more are given with --minutes.";
    say(`${why} Thank you! You may close this page, and end the recorder with Ctrl-C.`, "good");
    return;
  }
  await board.show(told.picture + (told.taken ? `?${told.taken}` : ""), "A table with a path");
  if (turn !== shown) return; // the person has taken an answer back
  next = told;
  board.redraw();
  since = performance.now();
  busy(false);
}

async function send(path, values) { // shows what is due, also after an answer from another window
  if (sending) return;
  sending = true;
  if ($("message").textContent) say("");
  const told = await ask(path, { user, ...values }).catch(error => {
    say(error.message, "bad");
    return ask("/api/begin", { user }).catch(() => null);
  });
  sending = false;
  if (told) await show(told);
}

function answer(valid) {
  if (!next || next.trial === null || next.wanted) return;
  send("/api/answer", { trial: next.trial, valid, response_ms: performance.now() - since });
}

async function begin(name) {
  user = name;
  $("who").hidden = true;
  say("Preparing the pictures …");
  try {
    const told = await ask("/api/begin", { user });
    say(told.apart ? "The folder has changed since an earlier sitting: its answers are kept apart." : "");
    await show(told);
    $("main").focus({ preventScroll: true }); // on neither answer: Enter should not mean one of them
  } catch (error) {
    say(error.message, "bad");
    $("who").hidden = false;
  }
}

board.layers = [(context, unit) => { if (next?.points) stroke(context, unit, next.points, "#f0e442"); }];
$("valid").addEventListener("click", () => answer(true));
$("invalid").addEventListener("click", () => answer(false));
$("undo").addEventListener("click", () => send("/api/undo", {}));
$("file").addEventListener("change", event => {
  const reader = new FileReader();
  reader.onload = () => next && send("/api/photograph", { trial: next.trial, picture: reader.result });
  if (event.target.files.length) reader.readAsDataURL(event.target.files[0]);
});
document.addEventListener("keydown", event => {
  if (event.repeat && event.key === "Enter") event.preventDefault(); // held on a button, it would go on judging
  const keys = { v: () => answer(true), n: () => answer(false), u: () => $("undo").disabled || send("/api/undo", {}) };
  const action = keys[event.key.toLowerCase()];
  if (!action || event.repeat || event.ctrlKey || event.metaKey || event.altKey || $("trial").hidden) return;
  event.preventDefault();
  action();
});
ask("/api/overview").then(({ users }) => {
  if (users.length === 1) return begin(users[0]);
  $("users").replaceChildren(...users.map(name => {
    const button = element("button", name);
    button.addEventListener("click", () => begin(name));
    return button;
  }));
  $("who").hidden = false;
}).catch(error => say(error.message, "bad")).then(() => busy(false));
