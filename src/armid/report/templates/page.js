(() => {
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();

  // Where nothing can hover, a finger on a plot scrolls the page, and buttons would lie over the lines for good.
  const touch = matchMedia("(hover: none)").matches;

  // Looks come from armid.report.look with colours by the names that they have in the style sheet.
  function coloured(look) {
    if (typeof look === "string") return look.startsWith("--") ? colour(look.slice(2)) : look;
    if (Array.isArray(look)) return look.map(coloured);
    if (look === null || typeof look !== "object" || look.bdata) return look;
    return Object.fromEntries(Object.entries(look).map(([key, value]) => [key, coloured(value)]));
  }

  function layout(plot, narrow) {
    const { xaxis, yaxis, shapes } = coloured(plot.layout);
    const sparse = narrow ? { nticks: 5 } : {};
    return {
      font: { family: getComputedStyle(document.body).fontFamily, size: 11, color: colour("soft") },
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      margin: { l: 54, r: 8, t: 8, b: 36 },
      showlegend: false,
      hovermode: "closest",
      dragmode: touch ? false : "zoom",
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("soft"), activecolor: colour("link") },
      hoverlabel: { bgcolor: colour("wash"), bordercolor: colour("rule"), font: { color: colour("ink") } },
      xaxis: { ...xaxis, ...sparse },
      yaxis: { ...yaxis, ...sparse },
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
    Plotly.react(place, plot.data.map(coloured), layout(plot, place.clientWidth < 260), options);
    if (first && plot.group) place.on("plotly_relayout", (change) => follow(place, plot.group, change));
  }

  // Plots of one group show the same stretch of their abscissa.
  let following = false;
  function follow(leader, group, change) {
    const keys = Object.keys(change).filter((key) => key.startsWith("xaxis."));
    if (following || !keys.length) return;
    following = true;
    const same = Object.fromEntries(keys.map((key) => [key, change[key]]));
    const others = [...drawn].filter((each) => each !== leader && data.plots[each.dataset.plot].group === group);
    Promise.all(others.map((each) => Plotly.relayout(each, same))).finally(() => { following = false; });
  }

  // From top to bottom, a few at a time, so that the page can be read meanwhile.
  function drawNext() {
    const next = places.filter((place) => !drawn.has(place)).slice(0, 3);
    next.forEach(draw);
    if (next.length) setTimeout(drawNext, 0);
    else root.dataset.drawn = String(drawn.size);
  }

  function redraw() {
    places.filter((place) => drawn.has(place)).forEach(draw);
  }

  function fit() {
    drawn.forEach((place) => Plotly.relayout(place, { width: place.clientWidth, height: place.clientHeight }));
  }

  // Paper has nothing to press.
  const folded = [...document.querySelectorAll("details")];
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
    redraw();
    drawn.forEach((place) => Plotly.Plots.resize(place));
  });

  if (places.length) {
    unpack("plotly-packed").then(drawNext, (error) => {
      const bar = document.createElement("p");
      bar.className = "bar";
      bar.textContent = `The plots could not be drawn in this browser (${error.message}); every number is in the tables.`;
      document.body.prepend(bar);
    });
    dark.addEventListener("change", redraw);
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
