"""Terms of the extension, beside those of the core; vocabulary.ttl and shapes.ttl describe them."""

from linked_fleet_gateway.rdf.vocabulary import LF as CORE

LF = CORE.extended(
    "World Placement SceneObject SceneObjects Obstacle KeepOutZone Box Sphere Cylinder TriangleMesh"
    " WorldShape PlacementShape PlacementInput SceneObjectShape SceneObjectsShape SceneObjectInput"
    " PoseInFrameShape PoseInFrame world placement inFrame poseOf objects poses geometry size radius"
    " length stl Collisions Collision CollisionsShape collisions collision meets collisionFree"
)
