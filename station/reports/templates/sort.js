// Tables of the class `sortable` are sorted by a column when its heading is pressed: numbers by size, others as text.
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0], first = [...body.rows];
  const value = (row, at) => row.cells[at].textContent.trim().replace(/−/g, "-");
  [...table.tHead.rows[0].cells].forEach((head, at) => {
    const button = document.createElement("button");
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending", sign = down ? -1 : 1;
      for (const one of table.tHead.rows[0].cells) one.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const rows = first.map(row => [value(row, at), row]);
      const numbers = rows.every(([text]) => text === "—" || text === "" || !Number.isNaN(parseFloat(text)));
      rows.sort(([a], [b]) => {
        const [x, y] = [parseFloat(a), parseFloat(b)];
        if (numbers) return Number.isNaN(x) || Number.isNaN(y) ? Number.isNaN(x) - Number.isNaN(y) : sign * (x - y);
        return sign * a.localeCompare(b, "en", { numeric: true });
      });
      body.replaceChildren(...rows.map(([, row]) => row));
    });
  });
}
