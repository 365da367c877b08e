// What view.js takes of three.js: `./dev three` bundles it into three.min.js.
export {
  AlwaysDepth, AmbientLight, BackSide, BufferAttribute, BufferGeometry, CanvasTexture, Color, ColorManagement, DataTexture,
  DecrementWrapStencilOp, DirectionalLight, DoubleSide, EqualStencilFunc, IncrementWrapStencilOp, LinearSRGBColorSpace, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, MultiplyBlending, OrthographicCamera, Plane, PlaneGeometry, Points, PointsMaterial,
  Raycaster, Scene, Vector2, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
export { ViewHelper } from "three/addons/helpers/ViewHelper.js";
export { LineMaterial } from "three/addons/lines/LineMaterial.js";
export { LineSegments2 } from "three/addons/lines/LineSegments2.js";
export { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
export { CSS2DObject, CSS2DRenderer } from "three/addons/renderers/CSS2DRenderer.js";
