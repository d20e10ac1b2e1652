// Pictures of cameras: on the page of a camera, and small on the page of its robot.

import * as picture from "./picture.js";
import * as thumbnails from "./thumbnails.js";

export function start() {
  picture.start();
  thumbnails.start();
}
