// Transforms vertices to clip space. Statics are in world space with ids per vertex; a movable has a world matrix and uniform
// ids. The image's G-buffer, the shadow maps and the truth pass all use this shader, so that labels align with the image.
in vec3 in_position;
in vec3 in_normal;
in vec2 in_uv;
#ifdef ELSEWHERE
// Position of the same vertex at another moment, in the object's coordinates at that moment.
in vec3 in_elsewhere;
out vec3 elsewhere;
#endif
uniform mat4 clip_from_world;
uniform vec4 depth_row;
#ifdef MOVABLE
uniform mat4 world;
uniform mat3 normal_matrix;
uniform uvec3 ids;
#else
in uvec3 in_ids;
#endif
#ifdef BEYOND
uniform vec4 beyond;     // only what lies on the positive side of this plane is drawn
#endif
out vec3 world_position;
out vec3 world_normal;
out vec2 uv;
out float axis_depth;
flat out uint material_row;
flat out uint label;
flat out uint instance;

void main() {
#ifdef MOVABLE
    vec4 position = world * vec4(in_position, 1.0);
    world_normal = normal_matrix * in_normal;
    uvec3 all_ids = ids;
#else
    vec4 position = vec4(in_position, 1.0);
    world_normal = in_normal;
    uvec3 all_ids = in_ids;
#endif
    material_row = all_ids.x;
    label = all_ids.y;
    instance = all_ids.z;
    world_position = position.xyz;
    uv = in_uv;
#ifdef ELSEWHERE
    elsewhere = in_elsewhere;
#endif
    axis_depth = dot(depth_row, position);
    gl_Position = clip_from_world * position;
#ifdef BEYOND
    gl_ClipDistance[0] = dot(beyond, position);
#endif
}
