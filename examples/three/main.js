// Left: every pixel computed by the exported network, under a light that can be turned. Right: the lightmap that was
// baked with it, on the second set of texture coordinates, under the one light of the run.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { depthMaterial, lightUniforms, loadNet, netMaterial, setLight } from "./net.js";
import { turnedAboutY } from "./sh.js";

const byId = (id) => document.getElementById(id);

// ?run=FOLDER names the run folder as the web server sees it.
async function start() {
  const folder = new URLSearchParams(location.search).get("run") ?? "run";
  const [gltf, net] = await Promise.all([new GLTFLoader().loadAsync(`${folder}/lightmap.glb`), loadNet(folder)]);
  const about = gltf.asset.extras?.prtnet;
  if (about?.format !== 1) throw new Error(`${folder}/lightmap.glb: found no prtnet of format 1; export it again`);

  const light = lightUniforms(net.outputs, about.groups);
  const exposure = { value: 1 };
  const pairs = await dress(gltf, net, about, light, exposure);

  const renderer = new THREE.WebGLRenderer({ antialias: true });
  renderer.setPixelRatio(devicePixelRatio);
  renderer.setScissorTest(true);
  document.body.prepend(renderer.domElement);
  // a shader that the driver refuses says so on the page, not only in the console
  renderer.debug.onShaderError = (gl, program, vertex, fragment) => say(gl.getShaderInfoLog(fragment));

  const scene = new THREE.Scene();
  scene.background = new THREE.Color("white");
  scene.add(gltf.scene);
  const camera = firstView(gltf), target = ahead(camera, new THREE.Vector3(...about.centre));
  const controls = new OrbitControls(camera, renderer.domElement); // turns the camera towards the origin at once
  controls.target.copy(target);
  controls.update();

  const depth = depthMaterial();

  function draw() {
    setLight(light, turnedAboutY(about.light.coefficients, Number(byId("turn").value)));
    exposure.value = Number(byId("exposure").value) * (Math.PI / about.lightmap.range);
    const width = innerWidth / 2;
    camera.aspect = width / innerHeight;
    camera.updateProjectionMatrix();
    renderer.setSize(innerWidth, innerHeight);
    [0, 1].forEach((side) => {
      for (const { mesh, materials } of pairs) mesh.material = materials[side];
      for (const { materials } of pairs) materials[1].lightMapIntensity = about.lightmap.range * exposure.value;
      renderer.setViewport(side * width, 0, width, innerHeight);
      renderer.setScissor(side * width, 0, width, innerHeight);
      if (side === 0) {
        scene.overrideMaterial = depth;
        renderer.render(scene, camera);
        scene.overrideMaterial = null;
      }
      renderer.autoClearDepth = side === 1;
      renderer.render(scene, camera);
      renderer.autoClearDepth = true;
    });
    document.body.dataset.frames = Number(document.body.dataset.frames ?? 0) + 1;
  }

  // Frames are drawn when something changes, never twice for one screen refresh: a network at every pixel costs.
  let waiting = false;
  const changed = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  };
  controls.addEventListener("change", changed);
  addEventListener("resize", changed);
  byId("controls").addEventListener("input", changed);
  byId("spin").addEventListener("input", () => spin(performance.now(), changed));
  say("");
  changed();
}

// Both materials of every part: { mesh, materials: [network, lightmap] }.
async function dress(gltf, net, about, light, exposure) {
  const meshes = [];
  gltf.scene.traverse((node) => { if (node.isMesh) meshes.push(node); });
  return Promise.all(meshes.map(async (mesh) => {
    const standard = mesh.material, baked = standard.userData.prtnet.lightmap;
    // glTF has no lightmap, so the loader does not know this texture: it hangs in the material's extras
    const lightMap = await gltf.parser.getDependency("texture", baked.index);
    lightMap.channel = baked.texCoord;
    lightMap.colorSpace = THREE.SRGBColorSpace;
    // three.js divides lightMap by pi: it means irradiance, as the file does
    const plain = new THREE.MeshBasicMaterial({ color: standard.color, map: standard.map, lightMap });
    return { mesh, materials: [netMaterial(net, about, standard, light, exposure), plain] };
  }));
}

// The file's camera, freed from the node it hangs on so that OrbitControls may move it.
function firstView(gltf) {
  gltf.scene.updateMatrixWorld(true);
  // its near plane was moved up to this one view
  const [placed] = gltf.cameras, camera = new THREE.PerspectiveCamera(placed.fov, 1, placed.far / 2000, placed.far);
  placed.matrixWorld.decompose(camera.position, camera.quaternion, camera.scale);
  return camera;
}

// The point straight ahead that is as far away as `centre`, to orbit around.
function ahead(camera, centre) {
  const forward = camera.getWorldDirection(new THREE.Vector3());
  return forward.clone().multiplyScalar(forward.dot(centre.sub(camera.position))).add(camera.position);
}

function spin(before, changed) {
  if (!byId("spin").checked) return;
  requestAnimationFrame((now) => {
    const turn = Number(byId("turn").value) + 0.03 * (now - before); // degrees: twelve seconds a turn
    byId("turn").value = ((turn + 180) % 360) - 180;
    changed();
    spin(now, changed);
  });
}

function say(text) {
  byId("message").textContent = text;
}

start().catch((error) => say(error.message));
