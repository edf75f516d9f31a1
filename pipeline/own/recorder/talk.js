// Talks to the person by the page, and to the server: sends JSON, returns its answer, turns every failure into a sentence.
export const $ = id => document.getElementById(id);

export function say(text, kind = "") {
  $("message").textContent = text;
  $("message").className = `message ${kind}`;
}

export function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== null) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

export async function ask(path, body) {
  const options = body === undefined ? {} : { method: "POST", body: JSON.stringify(body) };
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Error(`The recorder does not answer. Start it again with --port ${location.port}, then try again here.`);
  }
  const told = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(sentence(told.error ?? `The recorder failed (${answer.status}).`));
  return told;
}

const sentence = text => text.charAt(0).toUpperCase() + text.slice(1) + (text.endsWith(".") ? "" : ".");
