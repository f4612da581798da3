// The scene: the arm as nested groups that three.js draws. Lengths in metres; up is where nothing falls.

// Poses in which the extent of the arm is measured, and the width of the picture over what the arm needs.
const [POSES, MARGIN] = [24, 1.1];

function unpackNumbers({ dtype, bdata }) {
  const bytes = Uint8Array.from(atob(bdata), (letter) => letter.charCodeAt(0));
  return new { f4: Float32Array, u1: Uint8Array, u2: Uint16Array, u4: Uint32Array }[dtype](bytes.buffer);
}

// The eight corners of a box, the lowest first and the highest last.
function corners(low, high) {
  return Array.from({ length: 8 }, (_, k) =>
    new THREE.Vector3(...["x", "y", "z"].map((x, i) => ((k >> i) & 1 ? high : low)[x])));
}

class View {
  constructor(place, data, colour) {
    this.place = place;
    this.data = data;
    this.colour = colour;
    this.layers = {};
    this.tints = [];
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    place.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.root = new THREE.Group();
    this.root.quaternion.setFromUnitVectors(new THREE.Vector3(...data.down), new THREE.Vector3(0, 0, -1));
    this.scene.add(this.root);
    this.sky = new THREE.HemisphereLight(0xffffff, 0x8890a0, 1.6);
    this.sky.position.set(0, 0, 1);
    const sun = new THREE.DirectionalLight(0xffffff, 1.9);
    sun.position.set(2, -3, 4);
    this.scene.add(this.sky, sun);
    this.camera = new THREE.PerspectiveCamera(35, 1, data.reach / 100, data.reach * 60);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.draw());
    this.build();
    this.paint();
    new ResizeObserver(() => this.fit()).observe(place);
    this.fit();
    this.home();
  }

  // Building ------------------------------------------------------------------------------------------------------

  build() {
    const { joints, tip, reach } = this.data;
    this.links = [];
    for (const joint of joints) {
      const frame = this.framed(joint.placement);
      const moving = new THREE.Group();
      frame.add(moving);
      this.carrier(joint.parent).add(frame);
      this.links.push(moving);
    }
    this.axes = joints.map((joint) => new THREE.Vector3(...joint.axis));
    this.thin = reach / 220;
    for (const name of ["bodies", "skeleton", "path", "surroundings"]) this.layers[name] = [];
    this.buildBodies();
    this.buildSkeleton();
    this.buildSurroundings();
    this.data.layers.forEach((layer, k) => this.buildMasses(layer, k));
    this.tip = this.framed(tip.placement);
    this.carrier(tip.link).add(this.tip);
    this.show("path", this.tip, this.ball(2.2 * this.thin, this.material("orange")));
    const path = new THREE.BufferGeometry();
    path.setAttribute("position", new THREE.BufferAttribute(unpackNumbers(this.data.path), 3));
    const line = new THREE.LineBasicMaterial();
    this.tints.push([line, "orange"]);
    this.show("path", this.root, new THREE.Line(path, line));
    this.buildGap();
  }

  carrier(link) {
    return link < 0 ? this.root : this.links[link];
  }

  framed(placement) {
    const group = new THREE.Group();
    group.matrixAutoUpdate = false;
    group.matrix.fromArray(placement);
    return group;
  }

  material(name, options = {}) {
    const made = new THREE.MeshStandardMaterial({ roughness: 0.7, metalness: 0.05, ...options });
    this.tints.push([made, name]);
    return made;
  }

  show(layer, parent, ...objects) {
    parent.add(...objects);
    this.layers[layer].push(...objects);
  }

  ball(radius, material) {
    return new THREE.Mesh(new THREE.SphereGeometry(radius, 20, 14), material);
  }

  // Primitives lie along z, as in the descriptions; three.js has them along y.
  solid({ kind, size }) {
    const [a, b, c] = size;
    if (kind === "ellipsoid") return new THREE.SphereGeometry(1, 32, 20).scale(a, b, c);
    if (kind === "sphere") return new THREE.SphereGeometry(a, 32, 20);
    if (kind === "box") return new THREE.BoxGeometry(...size);
    const made = kind === "capsule" ? new THREE.CapsuleGeometry(a, b, 12, 32) : new THREE.CylinderGeometry(a, a, b, 40);
    return made.rotateX(Math.PI / 2);
  }

  mesh({ low, step, places, index }) {
    const steps = unpackNumbers(places);
    const made = new THREE.BufferGeometry();
    made.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(steps, (x, k) => low[k % 3] + step[k % 3] * x), 3));
    made.setIndex(new THREE.BufferAttribute(unpackNumbers(index), 1));
    return made;
  }

  buildBodies() {
    const meshes = this.data.meshes.map((each) => this.mesh(each));
    this.bodyMaterials = [
      this.material("body"), this.material("body-2"),
      this.material("body", { flatShading: true, side: THREE.DoubleSide }),
      this.material("body-2", { flatShading: true, side: THREE.DoubleSide }),
    ];
    for (const body of this.data.bodies) {
      const isMesh = body.kind === "mesh";
      const material = this.bodyMaterials[(body.link + 1) % 2 + (isMesh ? 2 : 0)];
      const frame = this.framed(body.placement);
      frame.add(new THREE.Mesh(isMesh ? meshes[body.mesh] : this.solid(body), material));
      this.show("bodies", this.carrier(body.link), frame);
    }
  }

  rod(from, to, radius, material) {
    const way = new THREE.Vector3().subVectors(to, from);
    const made = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, Math.max(way.length(), 1e-6), 16), material);
    made.position.addVectors(from, to).multiplyScalar(0.5);
    made.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
    return made;
  }

  buildSkeleton() {
    const rods = this.material("grey");
    const drums = this.material("blue");
    const none = new THREE.Vector3();
    const origin = ({ placement }) => new THREE.Vector3(...placement.slice(12, 15));
    this.data.joints.forEach((joint, k) => {
      const half = this.axes[k].clone().multiplyScalar(9 * this.thin);
      this.show("skeleton", this.links[k], this.rod(half.clone().negate(), half, 2.4 * this.thin, drums));
      if (origin(joint).length() > this.thin) this.show("skeleton", this.carrier(joint.parent), this.rod(none, origin(joint), 1.2 * this.thin, rods));
    });
    const { tip } = this.data;
    if (origin(tip).length() > this.thin) this.show("skeleton", this.carrier(tip.link), this.rod(none, origin(tip), 1.2 * this.thin, rods));
  }

  buildSurroundings() {
    const { surroundings, reach } = this.data;
    const walls = this.material("wall", { transparent: true, opacity: 0.55, side: THREE.DoubleSide, depthWrite: false });
    const across = Math.ceil(4 * reach);
    const grid = () => {
      const made = new THREE.GridHelper(across, 2 * across);
      made.material.vertexColors = false;
      this.tints.push([made.material, "rule"]);
      return made.rotateX(Math.PI / 2);
    };
    for (const each of surroundings) {
      const frame = this.framed(each.placement);
      if (each.kind === "half-space") frame.add(new THREE.Mesh(new THREE.PlaneGeometry(across, across), walls), grid());
      else frame.add(new THREE.Mesh(this.solid(each), walls));
      this.show("surroundings", this.root, frame);
    }
    if (!surroundings.some(({ kind }) => kind === "half-space")) this.show("surroundings", this.root, grid());
  }

  // The first layer has smooth ellipsoids and balls, the second nets and cubes, so that colour is not needed.
  buildMasses({ bodies }, k) {
    const name = `masses-${k}`;
    this.layers[name] = [];
    const size = 3.2 * this.thin;
    const first = k === 0;
    const look = first ? { transparent: true, opacity: 0.5, depthWrite: false } : { wireframe: true };
    const skin = this.material(first ? "blue" : "orange", look);
    const heart = this.material(first ? "blue" : "orange");
    for (const { link, com, axes, turn } of bodies) {
      const frame = new THREE.Group();
      frame.position.set(...com);
      frame.add(new THREE.Mesh(first ? new THREE.SphereGeometry(size, 16, 12) : new THREE.BoxGeometry(1.5 * size, 1.5 * size, 1.5 * size), heart));
      if (axes) {
        const [x, y, z] = [0, 3, 6].map((at) => new THREE.Vector3(...turn.slice(at, at + 3)));
        const body = new THREE.Mesh(first ? new THREE.SphereGeometry(1, 32, 20) : new THREE.SphereGeometry(1, 12, 8), skin);
        body.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(x, y, z));
        body.scale.set(...axes.map((half) => Math.max(half, 1e-4)));
        frame.add(body);
      }
      frame.visible = false;
      this.show(name, this.carrier(link), frame);
    }
  }

  buildGap() {
    this.gap = new THREE.Group();
    const material = this.material("near", { depthTest: false });
    this.gapLine = new THREE.Mesh(new THREE.CylinderGeometry(0.7 * this.thin, 0.7 * this.thin, 1, 10), material);
    this.gapEnds = [0, 1].map(() => this.ball(1.6 * this.thin, material));
    this.gap.add(this.gapLine, ...this.gapEnds);
    this.gap.renderOrder = 2;
    this.gap.visible = false;
    this.root.add(this.gap);
  }

  // Moving --------------------------------------------------------------------------------------------------------

  pose(q) {
    this.q = q;
    this.data.joints.forEach((joint, k) => {
      if (joint.slides) this.links[k].position.copy(this.axes[k]).multiplyScalar(q[k]);
      else this.links[k].quaternion.setFromAxisAngle(this.axes[k], q[k]);
    });
  }

  between(points) {
    this.gap.visible = Boolean(points);
    if (!points) return;
    const [a, b] = [0, 3].map((at) => new THREE.Vector3(...points.slice(at, at + 3)));
    this.gapEnds[0].position.copy(a);
    this.gapEnds[1].position.copy(b);
    const way = b.clone().sub(a);
    this.gapLine.position.copy(a).add(b).multiplyScalar(0.5);
    this.gapLine.scale.set(1, Math.max(way.length(), 1e-6), 1);
    if (way.length() > 1e-9) this.gapLine.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
  }

  // Where the tip is in the base frame, for whoever wants to check it.
  tipPlace() {
    this.scene.updateMatrixWorld(true);
    return this.root.worldToLocal(new THREE.Vector3().setFromMatrixPosition(this.tip.matrixWorld)).toArray();
  }

  // Looking -------------------------------------------------------------------------------------------------------

  set(layer, visible) {
    for (const each of this.layers[layer]) each.visible = visible;
    const inside = Object.keys(this.layers).some((name) => name.startsWith("masses") && this.layers[name].some((each) => each.visible));
    for (const material of this.bodyMaterials) {
      Object.assign(material, { transparent: inside, opacity: inside ? 0.28 : 1, depthWrite: !inside });
      material.needsUpdate = true;
    }
    this.draw();
  }

  paint() {
    for (const [material, name] of this.tints) material.color.set(this.colour(name));
    this.draw();
  }

  // Corners of a box around the path of the tip and the drawn bodies, in some poses of the motion.
  extent() {
    const [low, high] = [Infinity, -Infinity].map((x) => new THREE.Vector3(x, x, x));
    const include = (point) => [low.min(point), high.max(point)];
    const own = this.layers.bodies.filter((_, k) => this.data.bodies[k].link >= 0 || !this.data.side);
    const meshes = [];
    for (const each of [...own, ...this.layers.skeleton]) each.traverse((object) => object.isMesh && meshes.push(object));
    const [n, q, now] = [this.data.joints.length, unpackNumbers(this.data.q), this.q];
    const count = n ? q.length / n : 0;
    for (let k = 0; k < count; k += Math.max(1, Math.floor(count / POSES))) {
      this.pose(q.slice(k * n, (k + 1) * n));
      this.scene.updateMatrixWorld(true);
      for (const { geometry, matrixWorld } of meshes) {
        if (!geometry.boundingBox) geometry.computeBoundingBox();
        const { min, max } = geometry.boundingBox;
        for (const corner of corners(min, max)) include(corner.applyMatrix4(matrixWorld));
      }
    }
    if (now) this.pose(now);
    const path = unpackNumbers(this.data.path);
    for (let k = 0; k < path.length; k += 3) include(this.root.localToWorld(new THREE.Vector3(...path.slice(k, k + 3))));
    include(this.root.localToWorld(new THREE.Vector3()));
    return corners(low, high);
  }

  home() {
    const ends = this.extent();
    const middle = this.controls.target.addVectors(ends[0], ends[7]).multiplyScalar(0.5);
    const from = new THREE.Vector3(0.78, -0.86, 0.5);
    if (this.data.side) {
      const origin = this.root.localToWorld(new THREE.Vector3());
      from.copy(this.root.localToWorld(new THREE.Vector3(...this.data.side))).sub(origin).normalize();
      from.add(new THREE.Vector3(0, 0, 0.4));
    }
    from.normalize();
    const right = this.camera.up.clone().cross(from).normalize();
    const axes = [right, from.clone().cross(right)];
    const tan = Math.tan((this.camera.fov * Math.PI) / 360);
    let away = this.data.reach;
    for (const corner of ends) {
      corner.sub(middle);
      const [across, along] = axes.map((axis) => Math.abs(axis.dot(corner)));
      away = Math.max(away, corner.dot(from) + (MARGIN * Math.max(along, across / this.camera.aspect)) / tan);
    }
    this.camera.position.copy(middle).add(from.multiplyScalar(away));
    this.controls.update();
    this.draw();
  }

  fit() {
    const { clientWidth, clientHeight } = this.place;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  // At most once a frame of the screen.
  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.renderer.render(this.scene, this.camera);
      document.documentElement.dataset.drawn = "true";
    });
  }
}

