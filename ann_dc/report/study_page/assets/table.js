"use strict";

// The table of all points: decoded once, sorted and filtered as arrays; only the rows that can be
// seen are elements of the page.
(async () => {
  const HEIGHT = 26; // of a row, as the style sheet has it
  const AROUND = 15; // rows beyond either edge of the window
  const TALLEST = 8e6; // pixels that every browser can scroll
  const ARRAYS = { float64: Float64Array, uint8: Uint8Array, uint16: Uint16Array, uint32: Uint32Array };
  const MEASURED = 300; // rows that tell how wide a column is

  const byId = (name) => document.getElementById(name);
  const made = (tag, text, words = {}) =>
    Object.assign(document.createElement(tag), text === undefined ? {} : { textContent: text }, words);

  async function decoded(text) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const whole = await new Response(stream).arrayBuffer();
    const size = new DataView(whole).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(whole, 4, size)));
    const start = Math.ceil((4 + size) / 8) * 8;
    for (const column of head.columns) {
      column.values = new ARRAYS[column.kind](whole, start + column.offset, head.rows);
    }
    return head;
  }

  const whole = (column, row) => {
    const value = column.values[row];
    return column.words ? column.words[value] : Number.isNaN(value) ? "" : String(value);
  };
  const short = (column, row) => {
    const value = column.values[row];
    if (column.words) return column.words[value];
    if (Number.isNaN(value)) return "";
    return Number.isInteger(value) && Math.abs(value) < 1e9 ? String(value) : String(Number(value.toPrecision(5)));
  };

  // ---- filters: a text becomes a test of a row; null where it is empty

  const COMPARED = {
    ">=": (a, b) => a >= b, "<=": (a, b) => a <= b, ">": (a, b) => a > b, "<": (a, b) => a < b,
    "=": (a, b) => a === b, "!": (a, b) => a !== b,
  };

  function ofWords(column, test) {
    const good = column.words.map(test);
    return (row) => good[column.values[row]];
  }

  function holding(column, part) {
    if (column.words) return ofWords(column, (word) => word.toLowerCase().includes(part));
    return (row) => short(column, row).includes(part) || whole(column, row).includes(part);
  }

  function oneTest(column, part) {
    const [, sign, rest] = part.match(/^(>=|<=|>|<|=|!)?(.*)$/s);
    const range = part.match(/^(.+?)\.\.(.+)$/);
    if (!column.words && range && isFinite(range[1]) && isFinite(range[2])) {
      return (row) => column.values[row] >= +range[1] && column.values[row] <= +range[2];
    }
    if (!sign) return holding(column, part);
    if (rest === "") return () => true; // still being typed
    if (!column.words) return isFinite(rest) ? (row) => COMPARED[sign](column.values[row], +rest) : () => false;
    if (sign === "=") return ofWords(column, (word) => word.toLowerCase() === rest);
    if (sign === "!") return ofWords(column, (word) => !word.toLowerCase().includes(rest));
    return ofWords(column, (word) => COMPARED[sign](word.toLowerCase(), rest));
  }

  function columnTest(column, text) {
    const wanted = text.trim().toLowerCase().replace(/([><=!])\s+/g, "$1");
    if (!wanted) return null;
    const parts = column.words ? [wanted] : wanted.split(/\s+/);
    const tests = parts.map((part) => oneTest(column, part));
    return (row) => tests.every((test) => test(row));
  }

  function searchTests(columns, text) {
    return text.trim().toLowerCase().split(/\s+/).filter(Boolean).map((part) => {
      const digits = /^[-+.\deinfty]+$/.test(part);
      const tests = columns.filter((column) => column.words || digits).map((column) => holding(column, part));
      return (row) => tests.some((test) => test(row));
    });
  }

  // ---- order

  const LETTERS = new Intl.Collator(undefined, { numeric: true });
  const WHOLE = /^-?\d+$/; // seeds, for instance, which are too large for numbers
  const compared = (a, b) => (a < b ? -1 : a > b ? 1 : 0);

  function ranks(column) {
    const whole = column.words.every((word) => word === "" || WHOLE.test(word));
    const keys = whole ? column.words.map((word) => BigInt(word)) : column.words;
    const compare = whole ? compared : LETTERS.compare;
    const found = new Float64Array(keys.length);
    const order = keys.map((_, code) => code).sort((a, b) => compare(keys[a], keys[b]));
    order.forEach((code, rank) => { found[code] = column.words[code] === "" ? NaN : rank; });
    return found;
  }

  function sorted(rows, column, direction) {
    let key = column.values;
    if (column.words) {
      column.ranks ??= ranks(column);
      key = Float64Array.from(column.values, (code) => column.ranks[code]);
    }
    const known = rows.filter((row) => !Number.isNaN(key[row]));
    const unknown = rows.filter((row) => Number.isNaN(key[row]));
    known.sort((a, b) => direction * compared(key[a], key[b]) || a - b);
    const found = new Uint32Array(rows.length);
    found.set(known);
    found.set(unknown, known.length);
    return found;
  }

  // ---- the page

  const table = await decoded(byId("table-data").textContent);
  const columns = table.columns;
  const command = JSON.parse(byId("command").textContent);
  const port = byId("window");
  const body = made("tbody");
  const state = { rows: Uint32Array.from({ length: table.rows }, (_, row) => row), by: null, direction: 1, chosen: -1 };
  const filters = [];

  function width(column) {
    const rows = Math.min(table.rows, MEASURED);
    let letters = Math.min(column.name.length + 3, 26);
    for (let row = 0; row < rows; row++) letters = Math.max(letters, short(column, row).length);
    return Math.max(9, Math.min(letters + 2, 34));
  }

  function heading(column) {
    const title = [column.name + (column.unit ? ` [${column.unit}]` : ""), column.says].filter(Boolean).join(": ");
    const button = made("button", column.name, { type: "button", title });
    const cell = made("th", undefined, { scope: "col" });
    button.addEventListener("click", () => {
      const turned = state.by === column && state.direction === 1;
      state.direction = turned ? -1 : 1;
      state.by = column;
      for (const other of cell.parentNode.children) other.removeAttribute("aria-sort");
      cell.setAttribute("aria-sort", turned ? "descending" : "ascending");
      renew();
    });
    cell.append(button);
    return cell;
  }

  function filter(column) {
    const input = made("input", undefined, { type: "text", placeholder: column.words ? "word" : ">= <", ariaLabel: `filter ${column.name}` });
    listening(input);
    filters.push([column, input]);
    const cell = made("th");
    cell.append(input);
    return cell;
  }

  let waiting = 0;
  function later() {
    clearTimeout(waiting);
    waiting = setTimeout(renew, 150);
  }

  // Shown a moment after the last letter, or at once by Enter.
  function listening(input) {
    input.addEventListener("input", later);
    input.addEventListener("change", renew);
  }

  function renew() {
    const tests = filters.map(([column, input]) => columnTest(column, input.value)).filter(Boolean);
    tests.push(...searchTests(columns, byId("search").value));
    let rows = Uint32Array.from({ length: table.rows }, (_, row) => row);
    if (tests.length) rows = rows.filter((row) => tests.every((test) => test(row)));
    state.rows = state.by ? sorted(rows, state.by, state.direction) : rows;
    byId("count").textContent = `${state.rows.length.toLocaleString("en")} of ${table.rows.toLocaleString("en")} rows`;
    port.scrollTop = 0;
    show();
  }

  function line(row) {
    const shown = made("tr", undefined, { className: row === state.chosen ? "chosen" : "" });
    for (const column of columns) {
      const cell = made("td", short(column, row), { title: whole(column, row) });
      if (!column.words) cell.className = "n";
      shown.append(cell);
    }
    shown.addEventListener("click", () => { state.chosen = row; detail(row); show(); });
    return shown;
  }

  function space(pixels) {
    const shown = made("tr", undefined, { className: "space" });
    const cell = made("td", undefined, { colSpan: columns.length });
    cell.style.height = `${pixels}px`;
    shown.append(cell);
    return shown;
  }

  function show() {
    const count = state.rows.length;
    const tall = Math.min(count * HEIGHT, TALLEST);
    const seen = Math.ceil(port.clientHeight / HEIGHT);
    const top = Math.min(port.scrollTop, tall);
    const scrolled = tall > port.clientHeight ? top / Math.max(1, tall - port.clientHeight) : 0;
    const at = tall < count * HEIGHT ? Math.round(scrolled * (count - seen)) : Math.floor(top / HEIGHT);
    const first = Math.max(0, at - AROUND);
    const last = Math.min(count, at + seen + AROUND);
    const above = tall < count * HEIGHT ? Math.max(0, top - (at - first) * HEIGHT) : first * HEIGHT;
    const lines = Array.from(state.rows.subarray(first, last), line);
    body.replaceChildren(space(above), ...lines, space(Math.max(0, tall - above - lines.length * HEIGHT)));
  }

  function detail(row) {
    const point = columns.find((column) => column.name === "point");
    const list = made("dl");
    for (const column of columns) {
      list.append(made("dt", column.name), made("dd", `${whole(column, row)} ${column.unit}`));
    }
    const words = `${command} --point ${whole(point, row)}`;
    const line = made("p", "Repeated by ");
    line.append(made("code", words, { className: "command" }));
    byId("detail").replaceChildren(line, list);
  }

  const head = made("thead");
  for (const kind of [heading, filter]) {
    const cells = made("tr");
    cells.append(...columns.map(kind));
    head.append(cells);
  }
  const group = made("colgroup");
  let total = 0;
  for (const column of columns) {
    const one = made("col");
    total += width(column);
    one.style.width = `${width(column)}ch`;
    group.append(one);
  }
  byId("rows").style.width = `${total}ch`;
  byId("rows").append(group, head, body);
  listening(byId("search"));
  byId("clear").addEventListener("click", () => {
    for (const [, input] of filters) input.value = "";
    byId("search").value = "";
    renew();
  });
  let asked = false;
  port.addEventListener("scroll", () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => { asked = false; show(); });
  });
  renew();
  document.documentElement.dataset.table = String(table.rows);
})();
