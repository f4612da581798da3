(() => {
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();

  // On touch screens a finger on a plot scrolls the page, and plot buttons would permanently cover the lines.
  const touch = matchMedia("(hover: none)").matches;

  // Styles come from armid.report.plots.style, with names of colours from the style sheet.
  function coloured(look) {
    if (typeof look === "string") return look.startsWith("--") ? colour(look.slice(2)) : look;
    if (Array.isArray(look)) return look.map(coloured);
    if (look === null || typeof look !== "object" || look.bdata) return look;
    return Object.fromEntries(Object.entries(look).map(([key, value]) => [key, coloured(value)]));
  }

  // Of two plots over one abscissa only the lower has tick labels and a title.
  function layout(plot, narrow, part) {
    const { xaxis, yaxis, shapes } = coloured(plot.layout);
    const sparse = narrow ? { nticks: 5 } : {};
    const above = part === "upper" ? { showticklabels: false, title: { text: "" } } : {};
    const few = part === "lower" ? { nticks: 4, title: { text: yaxis.title.text.replace(/ \[.*/, ""), standoff: 4 } } : {};
    const margins = { upper: { t: 8, b: 6 }, lower: { t: 4, b: 34 } }[part] || { t: 8, b: 36 };
    return {
      font: { family: getComputedStyle(document.body).fontFamily, size: 11, color: colour("soft") },
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      margin: { l: 54, r: 8, ...margins },
      showlegend: false,
      hovermode: "closest",
      dragmode: touch ? false : "zoom",
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("soft"), activecolor: colour("link") },
      hoverlabel: { bgcolor: colour("wash"), bordercolor: colour("rule"), font: { color: colour("ink") } },
      xaxis: { ...xaxis, ...sparse, ...above },
      yaxis: { ...yaxis, ...sparse, ...few },
      shapes,
    };
  }

  const options = {
    responsive: true,
    displaylogo: false,
    displayModeBar: touch ? false : "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "zoomIn2d", "zoomOut2d"],
  };
  const places = [...document.querySelectorAll("[data-plot]")];
  const drawn = new Set();

  function draw(place) {
    const plot = data.plots[place.dataset.plot];
    const first = !drawn.has(place);
    drawn.add(place);
    Plotly.react(place, plot.data.map(coloured), layout(plot, place.clientWidth < 260, place.dataset.part), options);
    if (first && plot.group) place.on("plotly_relayout", (change) => follow(place, plot.group, change));
  }

  // Plots of one group show the same range of their abscissa.
  let following = false;
  function follow(leader, group, change) {
    const keys = Object.keys(change).filter((key) => key.startsWith("xaxis."));
    if (following || !keys.length) return;
    following = true;
    const same = Object.fromEntries(keys.map((key) => [key, change[key]]));
    const others = [...drawn].filter((each) => each !== leader && data.plots[each.dataset.plot].group === group);
    Promise.all(others.map((each) => Plotly.relayout(each, same))).finally(() => { following = false; });
  }

  // From top to bottom, a few at a time, so that the page can be read meanwhile. What is folded waits until it is
  // opened, and is then as wide as its place.
  const isFolded = (place) => place.closest("details:not([open])") !== null;
  let drawing = false;
  function drawNext() {
    const next = places.filter((place) => !drawn.has(place) && !isFolded(place)).slice(0, 3);
    next.forEach(draw);
    drawing = next.length > 0;
    if (drawing) setTimeout(drawNext, 0);
    else root.dataset.drawn = String(drawn.size);
  }

  function redraw(within) {
    places.filter((place) => drawn.has(place) && !isFolded(place) && within.contains(place)).forEach((place) => {
      draw(place);
      Plotly.Plots.resize(place);
    });
  }

  function fit() {
    drawn.forEach((place) => Plotly.relayout(place, { width: place.clientWidth, height: place.clientHeight }));
  }

  const folded = [...document.querySelectorAll("main details")];
  document.addEventListener("toggle", ({ target }) => {
    if (!folded.includes(target)) return;
    label();
    if (!target.open) return;
    measure();
    if (!window.Plotly) return;
    redraw(target);
    if (!drawing) drawNext();
  }, true);

  // Everything at once, to search or to read on.
  const unfold = document.getElementById("unfold");
  const areAllOpen = () => folded.every((each) => each.open);
  function label() { unfold.textContent = areAllOpen() ? "Close all" : "Open all"; }
  unfold.hidden = !folded.length;
  label();
  unfold.addEventListener("click", () => {
    const open = !areAllOpen();
    folded.forEach((each) => { each.open = open; });
  });

  // An address may point into what is folded.
  function reveal() {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    for (let each = target && target.closest("details"); each; each = each.parentElement.closest("details")) {
      each.open = true;
    }
  }
  addEventListener("hashchange", reveal);
  reveal();

  // The contents: beside the page where there is room, else a bar that opens; where one is, is marked.
  const menu = document.querySelector("nav details");
  const beside = matchMedia("(min-width: 72rem)");
  const settle = () => { menu.open = beside.matches; };
  settle();
  beside.addEventListener("change", settle);
  if (!beside.matches) document.querySelectorAll("[data-wide]").forEach((each) => { each.open = false; });
  menu.addEventListener("click", ({ target }) => { if (target.closest("a") && !beside.matches) menu.open = false; });
  const links = new Map([...menu.querySelectorAll("a")].map((a) => [a.hash.slice(1), a]));
  const sections = [...links.keys()].map((id) => document.getElementById(id));
  function mark() {
    const passed = sections.filter((each) => each.getBoundingClientRect().top < innerHeight / 3);
    const ends = innerHeight + scrollY >= root.scrollHeight - 2 && scrollY > 0;
    const now = ends ? sections.at(-1) : passed.at(-1) || sections[0];
    links.forEach((a, id) => {
      if (now && id === now.id) a.setAttribute("aria-current", "true");
      else a.removeAttribute("aria-current");
    });
    document.getElementById("here").textContent = now ? links.get(now.id).textContent : "";
  }
  addEventListener("scroll", mark, { passive: true });
  mark();

  // Tables that are wider than their place say so.
  const wide = [...document.querySelectorAll(".scroll")];
  function measure() {
    wide.forEach((each) => {
      each.classList.toggle("more", each.scrollWidth > each.clientWidth + each.scrollLeft + 2);
      each.classList.toggle("moved", each.scrollLeft > 2);
    });
  }
  wide.forEach((each) => each.addEventListener("scroll", measure, { passive: true }));
  addEventListener("resize", measure);
  measure();

  // Paper has nothing to press.
  let opened = [];
  addEventListener("beforeprint", () => {
    opened = folded.filter((each) => !each.open);
    opened.forEach((each) => { each.open = true; });
  });
  addEventListener("afterprint", () => opened.forEach((each) => { each.open = false; }));

  addEventListener("beforeprint", () => {
    if (!window.Plotly) return;
    root.classList.add("paper");
    places.forEach(draw);
    fit();
  });
  addEventListener("afterprint", () => {
    if (!window.Plotly) return;
    root.classList.remove("paper");
    redraw(document);
  });

  if (places.length) {
    unpack("plotly-packed").then(drawNext, (error) => {
      const bar = document.createElement("p");
      bar.className = "bar";
      bar.textContent = `The plots could not be drawn in this browser (${error.message}); every number is in the tables.`;
      document.body.prepend(bar);
    });
    dark.addEventListener("change", () => redraw(document));
  }

  async function copy(text) {
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      const area = document.createElement("textarea");
      area.value = text;
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
  }

  document.addEventListener("click", async (event) => {
    const button = event.target.closest("[data-copy]");
    if (!button) return;
    await copy(data.tables[button.dataset.copy][button.dataset.form]);
    const said = button.parentElement.querySelector(".said");
    said.textContent = "Copied.";
    setTimeout(() => { said.textContent = ""; }, 2000);
    button.focus();
  });
})();
