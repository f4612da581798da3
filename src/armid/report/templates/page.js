(() => {
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();

  // Where nothing can hover, a finger on a plot scrolls the page, and buttons would lie over the lines for good.
  const touch = matchMedia("(hover: none)").matches;

  // What a role looks like: colour, dash and symbol each tell it from its neighbours.
  const LINES = {
    measured: { colour: "ink", width: 1.3 },
    predicted: { colour: "blue", width: 1.7, dash: "6px,3px" },
    recorded: { colour: "grey", width: 1, dash: "2px,2px" },
    training: { colour: "blue", width: 1.1 },
    unseen: { colour: "orange", width: 1.1 },
    single: { colour: "grey", width: 0.6 },
    mean: { colour: "ink", width: 2, symbol: "circle" },
    law: { colour: "orange", width: 2.4, dash: "7px,3px" },
    physical: { colour: "orange", width: 1.5, dash: "2px,3px" },
    "joint-1": { colour: "joint-1", width: 1.6 },
    "joint-2": { colour: "joint-2", width: 1.6, dash: "9px,3px" },
    "joint-3": { colour: "joint-3", width: 1.6, dash: "2px,3px" },
    "joint-4": { colour: "joint-4", width: 1.6, dash: "9px,3px,2px,3px" },
    "joint-5": { colour: "joint-5", width: 1.6, dash: "5px,2px" },
    "joint-6": { colour: "joint-6", width: 1.6, dash: "14px,4px" },
    "joint-7": { colour: "joint-7", width: 1.6, dash: "6px,2px,1px,2px,1px,2px" },
    limit: { colour: "orange", width: 1.4, dash: "5px,3px" },
  };
  const CLOUDS = {
    training: { colour: "blue", symbol: "circle-open" },
    unseen: { colour: "orange", symbol: "x-thin-open" },
    forward: { colour: "blue", symbol: "triangle-up" },
    backward: { colour: "orange", symbol: "triangle-down-open" },
    "joint-1": { colour: "joint-1", symbol: "circle", size: 7 },
    "joint-2": { colour: "joint-2", symbol: "square", size: 7 },
    "joint-3": { colour: "joint-3", symbol: "diamond", size: 8 },
    "joint-4": { colour: "joint-4", symbol: "cross-thin-open", size: 9 },
    "joint-5": { colour: "joint-5", symbol: "triangle-up", size: 8 },
    "joint-6": { colour: "joint-6", symbol: "x-thin-open", size: 8 },
    "joint-7": { colour: "joint-7", symbol: "triangle-down", size: 8 },
  };

  function trace({ role, x, y, name, cloud }) {
    const common = { type: "scatter", x, y, name, hovertemplate: "%{y:.4g} at %{x:.4g}<extra>" + name + "</extra>" };
    if (role === "edge" || role === "band") {
      const fill = role === "band" ? { fill: "tonexty", fillcolor: colour("band") } : {};
      return { type: "scatter", x, y, name, mode: "lines", line: { width: 0 }, hoverinfo: "skip", ...fill };
    }
    if (cloud) {
      const look = CLOUDS[role];
      const marker = { color: colour(look.colour), symbol: look.symbol, size: look.size || 4 };
      marker.opacity = look.size ? 1 : 0.55;
      marker.line = { width: look.size ? 2 : 1, color: marker.color };
      return { ...common, mode: "markers", marker };
    }
    const look = LINES[role];
    const line = { color: colour(look.colour), width: look.width, dash: look.dash || "solid" };
    if (!look.symbol) return { ...common, mode: "lines", line };
    return { ...common, mode: "lines+markers", line, marker: { color: line.color, symbol: look.symbol, size: 4 } };
  }

  function axis(title, logarithmic, narrow, decades) {
    return {
      title: { text: title, standoff: 4 },
      type: logarithmic ? "log" : "linear",
      exponentformat: "power",
      gridcolor: colour("grid"),
      linecolor: colour("rule"),
      zerolinecolor: colour("rule"),
      tickcolor: colour("rule"),
      ticks: "outside",
      tickangle: 0,
      ticklen: 3,
      ...(decades ? { dtick: 1 } : { nticks: narrow || logarithmic ? 5 : 7 }),
    };
  }

  function layout(plot, narrow) {
    const dotted = { type: "line", layer: "below", line: { color: colour("soft"), width: 1, dash: "1px,3px" } };
    const levels = plot.levels.map((y) => ({ ...dotted, xref: "paper", x0: 0, x1: 1, y0: y, y1: y }));
    const marks = plot.marks.map((x) => ({ ...dotted, yref: "paper", y0: 0, y1: 1, x0: x, x1: x }));
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
      xaxis: axis(plot.x, plot.log, narrow, plot.log),
      yaxis: axis(plot.y, plot.log, narrow, false),
      shapes: [...levels, ...marks],
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
    Plotly.react(place, plot.traces.map(trace), layout(plot, place.clientWidth < 260), options);
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
