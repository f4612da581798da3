(() => {
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const root = document.documentElement;
  const at = (id) => document.getElementById(id);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();
  const NEAR = 0.05; // share of a range or limit

  const joints = data.joints;
  const n = joints.length;
  const q = unpackNumbers(data.q);
  const dq = unpackNumbers(data.dq);
  const frames = q.length / n;
  const approach = data.approach && {
    pairs: data.approach.pairs,
    pair: unpackNumbers(data.approach.pair),
    distance: unpackNumbers(data.approach.distance),
    points: unpackNumbers(data.approach.points),
  };

  // A row of an array of rows at a share of the whole time.
  function row(values, width, share) {
    const place = share * (values.length / width - 1);
    const k = Math.min(Math.floor(place), values.length / width - 1);
    const part = place - k;
    return Array.from({ length: width }, (_, j) => {
      const here = values[k * width + j];
      return part ? here + part * (values[(k + 1) * width + j] - here) : here;
    });
  }

  // Joints ----------------------------------------------------------------------------------------------------------

  const rows = [...at("joints").children].map((item) => ({
    item,
    value: item.querySelector(".value"),
    position: item.querySelector(".position"),
    velocity: item.querySelector(".velocity"),
  }));
  const minus = (text) => (Number.parseFloat(text) === 0 ? text.replace("-", "") : text.replace("-", "−"));
  const digits = (number, decimals) => minus(number.toFixed(decimals));
  const bounded = joints.map(({ low, high }) => low !== null && high !== null);
  const ranges = joints.map(({ low, high }, j) => {
    if (bounded[j]) return [low, high];
    let [least, most] = [Infinity, -Infinity];
    for (let k = j; k < q.length; k += n) [least, most] = [Math.min(least, q[k]), Math.max(most, q[k])];
    return most > least ? [least, most] : [least - 1, most + 1];
  });
  rows.forEach(({ position, velocity }, j) => {
    position.classList.toggle("open", !bounded[j]);
    position.title = bounded[j] ? `${digits(ranges[j][0], 2)} to ${digits(ranges[j][1], 2)} ${joints[j].unit}` : "no limits known; the bar is the range of this motion";
    velocity.hidden = joints[j].fastest === null;
  });

  function showJoint({ item, value, position, velocity }, j, place, speed) {
    const [low, high] = ranges[j];
    const share = (place - low) / (high - low);
    const close = bounded[j] && Math.min(share, 1 - share) < NEAR;
    const fast = joints[j].fastest !== null && Math.abs(speed) > (1 - NEAR) * joints[j].fastest;
    value.textContent = `${close || fast ? "▲ " : ""}${digits(place, 3)} ${joints[j].unit}`;
    position.firstElementChild.style.left = `${100 * Math.min(1, Math.max(0, share))}%`;
    velocity.firstElementChild.style.width = `${Math.min(100, (100 * Math.abs(speed)) / (joints[j].fastest || Infinity))}%`;
    position.classList.toggle("near", close);
    velocity.classList.toggle("near", fast);
    item.classList.toggle("near", close || fast);
  }

  // Distances -------------------------------------------------------------------------------------------------------

  const SVG = "http://www.w3.org/2000/svg";
  const millimetres = (metres) => (metres < 1 ? `${digits(1000 * metres, 0)} mm` : `${digits(metres, 2)} m`);
  let cursor = null;
  function drawChart() {
    const chart = at("chart");
    const { distance, pair, pairs } = approach;
    const [least, most] = [Math.min(0, ...distance), Math.max(...distance, 1e-3)];
    const y = (value) => 33 - (32 * (value - least)) / (most - least);
    const x = (k) => (100 * k) / (distance.length - 1);
    if (distance.length < 2) {
      chart.remove();
      return;
    }
    const top = [...distance].map((value, k) => `${x(k).toFixed(2)} ${y(value).toFixed(2)}`).join(" L ");
    const make = (name, attributes) => {
      const made = document.createElementNS(SVG, name);
      for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
      chart.append(made);
      return made;
    };
    make("path", { d: `M 0 ${y(0)} L ${top} L 100 ${y(0)} Z` });
    make("line", { class: "zero", x1: 0, x2: 100, y1: y(0), y2: y(0) });
    cursor = make("line", { y1: 0, y2: 34 });
    const k = distance.indexOf(Math.min(...distance));
    const when = (k / (distance.length - 1)) * data.duration;
    at("least").textContent = `Least ${millimetres(distance[k])} at ${when.toFixed(1)} s, ${pairs[pair[k]]}; the chart goes up to ${millimetres(most)}.`;
    chart.addEventListener("pointerdown", (event) => {
      chart.setPointerCapture(event.pointerId);
      const follow = ({ clientX }) => {
        const { left, width } = chart.getBoundingClientRect();
        seek(data.duration * Math.min(1, Math.max(0, (clientX - left) / width)));
      };
      follow(event);
      chart.onpointermove = follow;
      chart.onpointerup = () => { chart.onpointermove = null; };
    });
  }

  function showApproach(share, view) {
    if (!approach) return;
    const count = approach.distance.length;
    const k = Math.round(share * (count - 1));
    const [distance] = row(approach.distance, 1, share);
    at("distance").textContent = `${distance < 0.05 ? "▲ " : ""}${millimetres(distance)}`;
    at("distance").classList.toggle("near", distance < 0.05);
    at("pair").textContent = approach.pairs[approach.pair[k]];
    if (cursor) for (const end of ["x1", "x2"]) cursor.setAttribute(end, 100 * share);
    if (view) view.between(approach.points.slice(6 * k, 6 * k + 6));
  }

  // Time ------------------------------------------------------------------------------------------------------------

  let view = null;
  let now = 0;
  let playing = false;
  let before = 0;
  const slider = at("time");

  function seek(time) {
    now = Math.min(Math.max(time, 0), data.duration);
    const share = data.duration > 0 ? now / data.duration : 0;
    const place = row(q, n, share);
    const speed = row(dq, n, share);
    rows.forEach((each, j) => showJoint(each, j, place[j], speed[j]));
    showApproach(share, view);
    slider.value = String(share);
    at("clock").textContent = `${now.toFixed(1)} of ${data.duration.toFixed(1)} s`;
    if (!view) return;
    view.pose(place);
    view.draw();
  }

  function play(on) {
    playing = on && frames > 1;
    at("play").textContent = playing ? "❚❚" : "▶";
    at("play").setAttribute("aria-label", playing ? "Pause" : "Play");
    if (!playing) return;
    before = performance.now();
    requestAnimationFrame(step);
  }

  function step(moment) {
    if (!playing) return;
    const next = now + (Math.max(moment - before, 0) / 1000) * Number(at("speed").value);
    before = moment;
    seek(next > data.duration ? next % data.duration : next);
    requestAnimationFrame(step);
  }

  at("play").addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => seek(Number(slider.value) * data.duration));
  at("player").classList.toggle("still", frames < 2);
  addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, button, label")) return;
    if (event.key === " ") play(!playing);
    else if (event.key === "ArrowRight") seek(now + 0.1);
    else if (event.key === "ArrowLeft") seek(now - 0.1);
    else return;
    event.preventDefault();
  });

  // The picture of the joints in the place of the arm, where a browser draws nothing in three dimensions.
  function showSkeleton(reason) {
    at("undrawn").textContent = `The arm could not be drawn in this browser (${reason}); the bars and distances beside it still move. The preview needs WebGL, which the settings of a browser may switch off.`;
    at("skeleton").hidden = false;
  }

  function begin() {
    view = new View(at("view"), data, colour);
    const canvas = view.renderer.domElement;
    canvas.addEventListener("webglcontextlost", () => showSkeleton("its WebGL context was lost"));
    canvas.addEventListener("webglcontextrestored", () => { at("skeleton").hidden = true; });
    at("home").addEventListener("click", () => view.home());
    for (const box of document.querySelectorAll("[data-layer]")) {
      box.addEventListener("change", () => view.set(box.dataset.layer, box.checked));
      view.set(box.dataset.layer, box.checked);
    }
    dark.addEventListener("change", () => view.paint());
    seek(now);
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches || location.hash === "#still";
    play(!still);
  }

  if (approach) drawChart();
  seek(0);
  unpack("three-packed").then(begin).catch((error) => {
    showSkeleton(error.message);
    play(true);
  });

  window.armidPreview = { seek, play, tip: () => view && view.tipPlace(), layer: (name, on) => view.set(name, on) };
})();
