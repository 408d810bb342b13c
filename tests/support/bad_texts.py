"""Bad files as text: what is changed, and what the message must say; ``bad_files.cases`` reads these tables.

A line is ``OLD -> NEW => PART | PART ...``: NEW instead of OLD in the sample of the format, and parts of the message.
The first part begins the message behind the file's name, after the number of the line where one is given.
``@ OLD => PLACE`` stands before lines that share both (``.key`` is below PLACE), ``~`` marks what JSON schemas cannot
see, ``;;`` is a line break, ``<x*5>`` is xxxxx, and a line that is indented goes on.
"""

from __future__ import annotations

ROBOTS = r"""
@ mass = 3.0
mass = = 3.0 => 8: not valid TOML
mass = 3.0;; mass = 4.0 => 9: not valid TOML | overwrite | each key once
mass = "3.0" => links.link1.mass | '3.0' | at least 0
mass = true => links.link1.mass | true | at least 0
mass = 1979-05-27 => links.link1.mass | 1979 | allowed
~ mass = nan => 8: links.link1.mass | got nan | a number that is at least 0
mass = "3 kg" => 8: links.link1.mass | got '3 kg' | a number
mass = 3,0 => 8: not valid TOML | Expected newline | one key = value
mass = 1e200 => links.link1.mass | 1e+200 | 1e+30
mass = 0x<f*9000> => links.link1.mass | 36000 bits | 1e+30
mass = <9*5000> => 8: not valid TOML | more than 4300 digits | up to 1e+30
~ mass = 0.<3*5000> => 8: not valid TOML | more than 4300 digits | up to 1e+30
mass = -3.0 => 8: links.link1.mass | -3.0 | at least 0
~ mass = 3.0;; modal_damping = 0.1 => links.link1.modal_damping | no modes | beam or modes
mass = 3.0;; modes = "arm.txt" => links.link1.modes | 'arm.txt' | a .npz file
modes = { count = 2 } => links.link1.modes | 'file' is missing | .npz file
modes = { file = "arm.npz", units = "inch" } => links.link1.modes.units | 'inch' | mm
@ stiffness = 1e6 => joints.joint1.x
stiffnes = 1e6 => 23: . | 'stiffnes' | mean 'stiffness' | damping
~ clearance = 1e-4 => .clearance | no stiffness | stiffness > 0
stiffness = 1e6, clearance = -1e-4 => .clearance | -0.0001 | at least 0
~ stiffness = 0, clearance = 1e-4 => .clearance | stiffness > 0
~ stiffness = 1, clearance = 0 => .clearance | no smoothing | 1e-12
stiffness = 1, clearance = 1, smoothing = 0 => .smoothing | 0 | 1e-12
~ stiffness = 1, smoothing = 1e-5 => .smoothing | no clearance
~ restitution_damping = 1.0 => .restitution_damping | no clearance
stiffness = 1, clearance = 1, restitution_damping = -1 => .restitution_damping | -1 | at least 0
~ stiffness_negative = 1e6 => .stiffness_negative | with stiffness
cubic = -1.0 => .cubic | -1 | at least 0
preload = inf => .preload | inf | finite
friction = 1.0 => .friction | 1.0 | a table | coulomb
~ friction = { viscous = 1.0 } => .friction | 'coulomb' is missing
~ friction = { coulomb = 1.0, static = 2.0 } => .friction | static and stribeck
~ friction = { coulomb = 1.0, stribeck = 0.1 } => .friction | static and stribeck
~ friction = { coulomb = 2.0, static = 1.0, stribeck = 0.1 } => .friction.static | 1.0 | at least coulomb, 2.0
friction = { coulomb = 1.0, static = 2.0, stribeck = 0.0 } => .friction.stribeck | 0.0 | 1e-12
friction = { coulomb = 1.0, statik = 2.0 } => 23: .friction | 'statik' | mean 'static'
~ drive = {} => .drive | there is nothing in it | lag, winding, controller
~ stiffness = 1e6, drive = { lag = 0.1 } => .drive | nothing drives 'joint1.x' | joint1.gamma
~ drive = { winding = { resistance = 1.0, inductance = 1e-3 } } => .drive.winding.torque_constant | it is missing
~ drive = { lag = 0.1, voltage_limit = 24.0 } => .drive.voltage_limit | there is no winding
~ drive = { controller = { velocity = { limit = 1.0 } } } => .drive.controller.velocity | there is no gain | kp, ki, kd
drive = { controller = { torque = { kp = 1.0 } } } => .drive.controller | 'torque' | position, velocity, current
drive = { lag = -0.1 } => .drive.lag | -0.1 | at least 1e-12
~ friction = { model = "lugre", coulomb = 1.0 } => .friction | 'bristle_stiffness' is missing
~ friction = { coulomb = 1.0, bristle_stiffness = 1e4 } => .friction.bristle_stiffness | the model is not lugre | with
    model = "lugre"
friction = { model = "dahl", coulomb = 1.0, bristle_stiffness = 1e4 } => .friction.model | 'dahl' | lugre
~ friction = { model = "lugre", coulomb = 0.0, bristle_stiffness = 1e4 } => .friction.coulomb | 0.0 | at least 1e-12
~ friction = { model = "lugre", coulomb = 1.0, bristle_stiffness = 1e4, smoothing = 1e-3 } => .friction.smoothing |
    the model is lugre
~ friction = { model = "lugre", coulomb = 1, static = 2, stribeck = 0.1, shape = "lorentzian", bristle_stiffness = 1e4
    } => .friction.shape | 'lorentzian' | the model is lugre | gaussian
~ friction = { model = "lugre", coulomb = 1.0, bristle_stiffness = 1e4, bristle_damping = 50.0, fade = 1.0 } =>
    .friction.fade | 1.0 | a lower velocity
~ friction = { coulomb = 1.0, bristle_damping = 5.0 } => .friction.bristle_damping | there is no bristle_stiffness
~ hysteresis = { stiffness = 1e5, beta = 10, gamma = -20 } => .hysteresis.gamma | -20.0 | from -10.0 to 10.0
~ hysteresis = { stiffness = 1e5, beta = 10, gamma = 5, share = 1 } => .hysteresis.share | 1.0 | less than 1
hysteresis = { stiffness = 1e5, beta = 10 } => .hysteresis | 'gamma' is missing
hysteresis = { model = "preisach", stiffness = 1e5, beta = 10, gamma = 5 } => .hysteresis.model | 'preisach' | bouc_wen
maxwell = 3 => .maxwell | got 3 | an array of branches
maxwell = [] => .maxwell | 1 to 8 tables
maxwell = [{ stiffness = 1, damping = 1 }, { stiffness = 1 }] => .maxwell.1 | 'damping' is missing
~ maxwell = { loss_factor = 0.1, band_hz = [1, 10] } => .maxwell | no stiffness
~ stiffness = 1e6, maxwell = { loss_factor = 0.1, band_hz = [10, 1] } => .maxwell.band_hz | that rise
~ hysteresis = { beta = 1, gamma = 0.5 } => .hysteresis | no hysteresis.stiffness
hysteresis = { stiffness = 1.0, beta = 1.0, gamma = 0.5, n = 0.5 } => .hysteresis.n | at least 1
maxwell = [{ stiffness = 1, damping = 0.0 }] => .maxwell.0.damping | 0.0
stiffness = 1.0, maxwell = { band_hz = [1.0, 2.0] } => .maxwell | loss_factor
curve = [[0, 0]] => .curve | 1 points | 2 to 64
curve = [<[0, 0], *65>] => .curve | 65 points | 2 to 64
~ curve = [[0, 0], [1, 2], [1, 3]] => .curve | point 2 | 1.0 after 1.0 | rise
curve = [[0, 0, 1], [1, 2, 3]] => .curve.0 | [0, 0, 1] | 2 numbers
curve = [[0, 0], [1, "a"]] => .curve.1.1 | 'a' | finite
curve = 3 => .curve | 3 | array of arrays
~ stiffness = 1, curve = [[0, 0], [1, 2]] => .curve | stiffness is set, too | instead of
~ curve = [[0, 0], [1, 2]], friction = { coulomb = 1, static = 2 } => .friction | static and stribeck
role = "drive" => .role | 'drive' | free, locked, prescribed
@
gravity = -> gravitiy = => 3: | 'gravitiy' | mean 'gravity' | allowed: name
x = { stiff -> delta = { stiff => joints.joint1 | 'delta' | allowed | gamma
gravity = -> "\u001b[31m\n" = =>  | '\x1b[31m\n' | allowed
x = { stiffness = 1e6, damping = 10 } -> x = 1e6 => joints.joint1.x | 1000000.0 | a table
gravity = [0.0, 0.0, -9.81] -> gravity = { z = -9.81 } => gravity | a table | 3 numbers
[0.1, 0.0, 0.0] -> [0.1, 0.0] => links.link1.com | [0.1, 0.0] | an array of 3 numbers
[0.1, 0.0, 0.0] -> [0.1, "a", 0.0] => 9: links.link1.com.1 | 'a' | a finite number
[0.1, 0.0, 0.0] -> [[0.1], 0.0, 0.0] => links.link1.com.0 | [0.1] | a finite number
[[frames]] -> [frames] => frames | a table | [[frames]]
-9.81 -> -inf => 3: gravity.2 | got -inf | a finite number
1e6 -> -1e6 => joints.joint1.x.stiffness | -1000000.0 | at least 0
damping = 10 -> damping = -10 => joints.joint1.x.damping | -10 | at least 0
0.02 -> -0.02 => joints.joint1.gamma.armature | -0.02 | at least 0
~ x = { stiffness = 1e6, damping = 10 } -> x = {};; stiffness = { matrix = [[1e6, 1e3], [1e3, 0.5]] } =>
    joints.joint1.stiffness.matrix | x.gamma | 1000.0 | up to 707.107 | units?
~ x = { stiffness = 1e6, damping = 10 } -> x = {};; damping = { matrix = [[1.0]] } => joints.joint1.damping.matrix | 1
    row | 2, for x, gamma, or six
~ x = { stiffness = 1e6, damping = 10 } -> x = {};; damping = { ratio = 0.02, at_hz = 40 } => joints.joint1.damping |
    no table stiffness | matrix
~ zz = 0.2 -> zz = 0.5 => 10: links.link1.inertia | no body | -0.1 | "warn" | "project" | --inertia
~ xx = 0.1 -> xx = -0.1 => links.link1.inertia | (-0.1, 0.2, 0.2 | allowed
~ zz = 0.2 -> zz = 0.2, xy = 0.3 => links.link1.inertia | eigenvalue - | allowed
, zz = 0.2 -> => links.link1.inertia | 'zz' | missing | kg m^2
~ mass = 3.0;; -> => 6: links.link1 | 'mass' | missing
name = "link1";; -> => links[0] | 'name' | missing
name = "arm";; -> =>  | 'name' | missing | lower-case
parent = "base";; -> => joints.joint1 | 'parent' | missing | 'base'
type = "revolute";; -> => joints.joint1 | 'type' | missing | prismatic
"revolute" -> "revolut" => joints.joint1.type | 'revolut' | mean 'revolute' | free
"revolute" -> "continuous" => joints.joint1.type | 'continuous' | mean 'revolute'
"revolute" -> "planar" => joints.joint1.type | 'planar' | revolute, prismatic, fixed, free
~ parent = "link1" -> parent = "lnk1" => joints.joint2.parent | 'lnk1' | mean 'link1' | base
~ child = "link2" -> child = "lnk2" => 30: joints.joint2.child | 'lnk2' | mean 'link2'
~ link = "link2" -> link = "hand" => frames.tcp.link | 'hand' | 'link1', 'link2'
~ child = "link2" -> child = "link1" => joints.joint2.child | 'link1' | 'joint1' | one parent
~ parent = "base" -> parent = "link2" => joints.joint | 'joint1', 'joint2' | form a cycle | a tree
~ parent = "link1" -> parent = "link2" => 27: joints.joint2 | 'joint2' | cycle
~ child = "link2" -> child = "base" => joints.joint2.child | 'base' | a link
~ [[frames]] -> [[links]];; name = "far";; mass = 1;; [[frames]] => links.far | one joint
~ name = "link2" -> name = "link1" => 12: links.link1 | is taken | unique names
~ name = "joint2" -> name = "joint1" => joints.joint1 | unique
name = "joint1" -> name = "\u03c6" => joints[0].name | '\u03c6' | letter
name = "arm" -> name = "Arm" => name | 'Arm' | lower-case | 'arm'
~ name = "arm" -> name = "arm\n" => name | 'arm\n' | lower-case
name = "arm" -> name = "<a*49>" => name | 'aaaa | 48
~ dh = -> placement = {};; dh = => joints.joint1 | both dh and placement | one of them
~ limits = [-1, 2] -> limits = [2, -1] => joints.joint1.limits | [2, -1] | lower <= upper
~ type = "revolute" -> type = "fixed" => joints.joint1.limits | fixed | revolute
~ gamma = { damping = 0.1 -> gamma = { limits = { velocity = 1 }, damping = 0.1 => joints.joint1.limits | gamma has
    limits | one of them
"prismatic" -> "prismatic";; z = { limits = { velocity = 0 } } => joints.joint2.z.limits.velocity | greater than 0
"prismatic" -> "prismatic";; z = { limits = { effort = -1 } } => joints.joint2.z.limits.effort | greater than 0
~ "prismatic" -> "prismatic";; z = { limits = { lower = 1, upper = -1 } } => joints.joint2.z.limits | lower is 1.0 |
    lower <= upper
~ "prismatic" -> "prismatic";; z = { limits = {} } => joints.joint2.z.limits | lower, upper, velocity
~ tunable = [ -> tunable = ["springs.rope.stiffness", => tunable | 'springs.rope.stiffness' | springs.SPRING.stiffness
~ child = -> node = "tip";; child = => joints.joint1.node | 'tip' | does not bend | root
~ alpha = -> alpha_deg = 9, alpha = => joints.joint1.dh.alpha_deg | alpha (rad) is given, too | one of them
~ gravity = -> driven = ["joint1.zeta"];; gravity = => driven | 'joint1.zeta' | mean 'joint2.z' | allowed
~ gravity = -> home = { joint9.x = 1 };; gravity = => home | 'joint9.x' | allowed
limits = [-1, 2] -> stiffness = { matrix = "K.txt" } => joints.joint1.stiffness.matrix | 'K.txt' | .mtx or .npz or .csv
limits = -> prescribed = ["w"];; limits = => joints.joint1.prescribed | 'w' | x, y, z, alpha
tunable = -> inertia = "ignore";; tunable = => inertia | 'ignore' | error, warn, project
["links.link2.mass"] -> [3] => tunable | [3] | an array of strings
@ name = "link1"
name = 1 => links[0].name | 1 | a string
~ name = "base" => links.base.name | another name
name = "link 1" => links[0].name | 'link 1' | letter | 'link_1'
~ name = "link1\n" => links[0].name | 'link1\n' | letter
name = "*/ int x; /*" => links[0].name | '*/ int x; /*' | letter
name = "" => links[0].name | '' | letter
name = "<l*5000>" => links[0].name | lll...' | 128
@loop => loops.loop
x = { limits = { velocity = 1 } } => .x | unknown key 'limits'
a = 1 => . | unknown key 'a' | placements
links = ["base", "link1", "link2"] => .links | two names
links = "link1" => .links | strings
~ links = ["link2", "lnk1"] => .links.1 | 'lnk1' | mean 'link1'
~ links = ["link2", "link2"] => .links | to itself | different
links;; type = "fixed" => . | 'links' is missing | two names
type => . | 'type' is missing | revolute | planar
type = "hinge" => .type | 'hinge' | mean 'revolute'
placements = [{}] => .placements | two tables
placements = [{}, {xy = 1}] => .placements.1 | 'xy' | xyz, rpy
~ placements = [{}, {rpy = [1, 0, 0], rpy_deg = [9, 0, 0]}] => .placements.1.rpy_deg | rpy (rad) is given, too | one
    of them
placements = [{}, {xyz = [1]}] => .placements.1.xyz | 3 numbers
x = { armature = 1 } => .x | 'armature' | stiffness, damping
x = { cubic = -1 } => .x.cubic | -1 | at least 0
@spring => springs.rope
stifness = 1 => . | 'stifness' | mean 'stiffness' | tension_only
links;; stiffness = 1 => . | 'links' is missing | two names
links = ["base", "link1", "link2"];; stiffness = 1 => .links | two names, each 'base' or a link
~ links = ["link2", "lnk1"];; stiffness = 1 => 36: .links.1 | 'lnk1' | mean 'link1'
~ links = ["link2", "link2"];; stiffness = 1 => .links | both ends are on one link | two different links
~ free_length = 1 => . | no force | stiffness, damping or curve
stiffness = -1 => .stiffness | -1 | at least 0
stiffness = 1;; free_length = -0.1 => .free_length | -0.1 | at least 0
damping = -2.0 => .damping | -2.0 | at least 0
stiffness = inf => .stiffness | inf | at least 0
stiffness = 1;; points = [[0, 0, 0]] => .points | 1 values | two points
stiffness = 1;; points = [[0, 0], [0, 0, 0]] => .points.0 | 3 numbers
~ stiffness = 1;; points = [[0, 0, nan], [0, 0, 0]] => .points.0.2 | nan | finite
stiffness = 1;; tension_only = "yes" => .tension_only | true or false
~ stiffness = 1;; tension_only = true => .tension_only | no free_length and no smoothing
~ stiffness = 1;; smoothing = 0.1 => .smoothing | with tension_only = true
stiffness = 1;; tension_only = true;; smoothing = 0 => .smoothing | at least 1e-12
~ stiffness = 1;; curve = [[0, 0], [1, 1]] => .curve | stiffness is set, too
~ tension_only = true;; smoothing = 0.1;; curve = [[0, 0], [1, 1]] => .curve | tension_only is set, too
~ curve = [[0, 0], [1, 1], [0.5, 2]] => .curve | point 2 | elongation 0.5 | elongations that rise
~ stiffness = 1;; [[springs]];; name = "rope";; links = ["link1", "base"];; damping = 1 => . | 'rope' is taken
stiffness = 1;; [[springs]];; name = "a b; x" => springs[1].name | 'a b; x'
@beam => beams.boom
length => . | 'length' is missing | greater than 0
lenght = 1 => . | 'lenght' | mean 'length' | segments
length = 0 => .length | got 0 | greater than 0
segments = 0 => .segments | got 0 | from 1 to 100
segments = 101 => .segments | got 101 | from 1 to 100
segments = 2.5 => .segments | 2.5 | whole number
~ E = nan => .E | nan | greater than 0
axis = "w" => .axis | 'w' | x, y, z, -x
~ parent = "lnk2" => .parent | 'lnk2' | mean 'link2' | the base or a link
~ child = "tpi" => .child | 'tpi' | mean 'tip'
~ child = "link2" => .child | the parent | two different links
~ child = "base" => .child | 'base' | nothing carries | a link
~ child = "link1" => .child | 'link1' | the child of joint 'joint1' | one parent
~ parent = "tip";; child = "boom1" => .child | child of joint 'boom1'
~ name = "link" => beams.link.name | link | 'link1', 'link2' | another name
~ name = "joint" => beams.joint.name | joint | 'joint1', 'joint2' | another
~ name = "<b*126>" =>  | .name | called after it | 124 characters
~ section => . | 'A' is missing | A, Iy, Iz, J, shear, or a section
~ section;; A = 1e-4;; Iy = 1e-9;; Iz = 1e-9;; J = 2e-9 => . | 'shear' is missing | or a section
~ section = { rod = 0.02, bar = [0.01, 0.02] } => .section | 2 keys | one of tube, rod, bar, box, I
~ section = {} => .section | 0 keys | one of tube, rod
section = { L = [1, 2] } => .section | 'L' | tube, rod
~ section = { tube = [0.02, 0.02] } =>  | section.tube | [0.02, 0.02] | below the outer
~ section = { box = [0.02, 0.01, 0.005] } =>  | section.box | [height, width, thickness] | below half
~ section = { I = [0.02, 0.01, 0.01, 0.001] } =>  | section.I | [height, width, flange, web] | thinner than half
section = { I = [0.02, 0.01, 0.001] } =>  | section.I | 4 numbers
section = { rod = -0.02 } =>  | section.rod | -0.02 | greater than 0
~ G = 1e10 => .G | ratio E / (2 G) - 1 is 2.5 | up to 0.5 | shear = [ky, kz]
shear = [0.8, 0.8, 0.8] => .shear | 2 numbers
~ damping = { ratio = 0.1, loss_factor = 0.1, at_hz = 1 } => .damping | both are given | one of ratio, loss_factor
~ damping = { at_hz = 1 } => .damping | none is given
damping = { ratio = 0.1 } => .damping | 'at_hz' is missing | Hz
damping = [1, 1, 1, 1, 1] => .damping | 6 numbers
damping = "much" => .damping | 'much' | a number in s, or six
~ rigid = ["x", "y", "z", "alpha", "beta", "gamma"] => .rigid | each once, not all
rigid = ["w"] => .rigid | 'w' | x, y, z, alpha
~ E = 1e30;; G = 5e29;; length = 1e-6 => . | stiffness x | from 1e-30 to 1e+30
~ length = 1e-200 => . | its segments have | allowed
@bent => links.boom
beam.length => .beam | 'length' is missing | greater than 0
beam.E = -1 => .beam.E | -1 | greater than 0
beam.modes => .beam | 'modes' is missing | whole numbers
~ beam.modes = {} => .beam.modes | there are none | y, z, torsion
beam.modes = { y = 0.5 } => .beam.modes.y | 0.5 | from 0 to 12
beam.modes = { z = 13 } => .beam.modes.z | 13 | from 0 to 12
beam.modes = { x = 1 } => .beam.modes | 'x' | torsion, axial
beam.axis = "w" => .beam.axis | 'w' | x, y, z, -x
~ beam.section => .beam | 'A' is missing | or a section
~ beam.G = 1e10 => .beam.G | 2.5 | up to 0.5
~ beam.length = 1e-200 => .beam | allowed
~ mass = 1 => .mass | got 1 | 0.4241 | no mass
~ com = [0, 0.1, 0] => .com[0] | 0.25 | no com
~ inertia = { xx = 1, yy = 1, zz = 1 } => .inertia.xx | got 1 | no inertia
~ modes = "a.npz" => .modes | both beam and modes | one of them
modal_damping = -0.1 => .modal_damping | -0.1 | at least 0
~ [[frames]];; name = "eye";; link = "boom";; node = "tpi" => frames.eye.node | 'tpi' | mean 'tip' | root, tip
~ [[springs]];; name = "s";; links = ["base", "boom"];; nodes = ["tip", "tip"];; stiffness = 1 => springs.s.nodes[0] |
    'tip' | 'base' | does not bend
[[springs]];; name = "s";; links = ["base", "boom"];; nodes = ["tip"];; stiffness = 1 => springs.s.nodes | two names
    of nodes
~ [[links]];; name = "boom_tip";; mass = 1;; [[joints]];; name = "j";; parent = "boom";; child = "boom_tip";; type =
    "revolute" => . | 'boom_tip' | taken | another name
beam.nodes = { start = 0.0 } => .beam.nodes.start | got 0.0 | greater than 0
~ beam.nodes = { far = 0.6 } => .beam.nodes.far | 0.6 | up to the length
~ beam.nodes = { tip = 0.2 } => .beam.nodes | 'tip' | identifiers but
beam.nodes = [0.2] => .beam.nodes | nodes
@along => joints.slides
along = "x" => .along | 'x' | beam
~ parent = "link2" => .along | 'link2' | no beam | links with beam
~ type = "revolute" => .along | revolute | prismatic
~ placement = { xyz = [0, 0, 1] } => .placement | slides along the beam's axis | z alone
~ x = {} => .x | z alone
~ limits = [0.1, 0.7] => .limits | 0.1 to 0.7 | 0 to 0.5 m
~ [[links]];; name = "boom_slides";; mass = 1;; [[joints]];; name = "j";; parent = "boom";; child = "boom_slides";;
    type = "revolute" => . | 'boom_slides' | taken | another name
@ links.link2.mass
~ links.lnk2.mass => 4: tunable | lnk2.mass | links.link2.mass
~ joints.joint3.x.damping => tunable | joint3.x | joints.joint1.x.damping
~ joints.joint2.x.damping => tunable | joint2.x | allowed: gravity
~ joints.joint1.placement.rpy => tunable | joint1 | dh has none
~ links.link*.mass => tunable | 'links.link*.mass' | any one component
"""

URDFS = r"""
<?xml -> hello <?xml => not well-formed XML
</robot> -> => 26: not well-formed XML
<robot -> <!DOCTYPE robot SYSTEM "http://localhost/x.dtd"><robot => 2: | document type | plain elements
<robot -> <!DOCTYPE r [<!ENTITY a "b">]><robot => | entity | plain elements
name="arm" -> name="&arm;" => not well-formed XML
<robot name="arm" -> <robot => robot | name is missing
<link -> <x:macro xmlns:x="http://ros.org/wiki/xacro"/><link => robot | xacro | expanded
<link name="lower" -> <link name="upper" => 11: link 'upper' | unique
<joint name="elbow" -> <joint name="shoulder" => joint 'shoulder' | unique
<link name="ground" -> <link => link number 1 | name is missing
type="revolute" -> type="helical" => joint 'shoulder' | 'helical' | continuous, prismatic, fixed, floating, planar
type="revolute" -> => joint 'shoulder' | type is missing | continuous, prismatic
<parent link="ground"/> -> => joint 'shoulder' | <parent
<child link="upper"/> -> => joint 'shoulder' | <child
<parent link="upper"/> -> <parent link="uper"/> => 22: joint 'elbow', <parent> | 'uper' | mean 'upper'
<child link="lower"/> -> <child link="upper"/> => robot | 2 links without a parent | 'ground', 'lower' | one root
</robot> -> <joint name="more" type="fixed"><parent link="ground"/><child link="lower"/></joint></robot> =>
    25: joints.more.child | 'lower' | 'elbow' | one parent
<parent link="ground"/> -> <parent link="ground"/><parent link="lower"/> =>
    15: joint 'shoulder' | 2 elements <parent> that differ
<parent link="ground"/> -> <parent link="lower"/> => 21: joints.elbow | cycle | a tree
</robot> -> <joint name="more" type="fixed"><parent link="lower"/><child link="ground"/></joint></robot> => robot |
    cycle | one root
<axis xyz="0 1 0"/> -> <axis xyz="0 0 0"/> => 17: joint 'shoulder', <axis> | [0.0, 0.0, 0.0] | direction
<axis xyz="0 1 0"/> -> <axis xyz="0 1"/> => joint 'shoulder', <axis> | '0 1' | three numbers
value="2.0" -> value="nan" => link 'upper', <inertial>, <mass> | 'nan' | a finite number
xyz="0 0 0.5" -> xyz="0 0 inf" => joint 'shoulder', <origin> | 'inf' | a finite number
value="2.0" -> value="1e999" => | '1e999' | a finite number
value="2.0" -> value="<9*5000>" => | 99...' | a finite number
value="2.0" -> value="2_0" => | '2_0' | a finite number
value="2.0" -> value="0x10" => | '0x10' | a finite number
value="2.0" -> value="&#x662;" => | '\u0662' | a finite number
value="2.0" -> value="-2.0" => 7: link 'upper', <inertial>, <mass> | -2 | at least 0
<mass value="2.0"/> -> => link 'upper', <inertial> | no <mass>
iyz="0" -> => 8: link 'upper', <inertial>, <inertia> | iyz is missing | a finite number
izz="0.15" -> izz="0.9" => 4: links.upper.inertia | eigenvalue - | "project"
damping="0.7" -> damping="-1" => joint 'shoulder', <dynamics> | -1 | at least 0
type="revolute" -> type="&#27;" => not well-formed XML
type="revolute" -> type="&lt;&#x202e;b&gt;" => | '<\u202eb>' | allowed
value="2.0" -> value="<2*5000>" => 7: link 'upper', <inertial>, <mass> | '2222 | a finite number
damping="0.7" -> damping="NaN" => 19: joint 'shoulder', <dynamics> | 'NaN' | a finite
xyz="0 1 0" -> xyz="0 1 0" xyz="1 0 0" => 17: not well-formed XML | duplicate | each attribute once
"""

SCENARIOS = r"""
@
 => the key 'duration' is missing | a time in s
duration = 0 => duration | got 0; allowed: a number that is at least 1e-09
duration = 'long' => duration | got 'long'; allowed: a number that is at least 1e-09
~ duration = nan => duration | got nan; allowed: a number that is at least 1e-09
duration = 1;; durations = 2 => | unknown key 'durations'; did you mean 'duration'?
duration = = 1 => | not valid TOML
@ duration = 0.1
output_step = -1 => output_step | got -1
output_step = 9.5e-10 => output_step | got 9.5e-10
frame = 3 => frame | got 3; allowed: a string
initial = 3 => initial | got 3; allowed: a table
[prescribed];; a = 1 => prescribed | written [[prescribed]]
[[prescribed]];; type = 'harmonic';; coordinate = 'a' => prescribed[0] | 'amplitude' is missing
[integrator];; method = 'euler' => integrator.method | got 'euler'
[integrator];; rtol = 2 => integrator.rtol | from 1e-13
@ duration = 0.1;; [initial]
q = [1.0] => initial.q | a table of numbers
q = { a = 'x' } => initial.q.a | got 'x'; allowed: a finite number
q = { 'a b' = 1 } => initial.q | got the name 'a b'
z = 1.0 => initial.z | a table of numbers by state
z = { a.x.friction.z = 'x' } => initial.z.a.x.friction.z | got 'x'; allowed: a finite number
z = { 'a b' = 1 } => initial.z | got the name 'a b'; allowed: names of states
equilibrium = 1 => initial.equilibrium | got 1; allowed: true or false
~ equilibrium = true;; v = { a = 1 } => initial.v | static equilibrium
~ held = ['a'] => initial.held | with equilibrium = true only
@ duration = 0.1;; [motion]
goal = [1] => motion | the key 'type' is missing; allowed: point_to_point
type = 'spiral' => motion.type | got 'spiral'
type = 'sampled';; file = 'm.np' => motion.file | got 'm.np'; allowed: the path of a .csv or .npz file
type = 'sampled';; file = 'm.txt' => motion.file | got 'm.txt'; allowed: the path of a .csv
~ type = 'sampled';; file = 'm.csv' => motion.file | does not exist
type = 'line';; from = [0, 0, 1] => motion | the key 'to' is missing
~ type = 'line';; from = [0, 0, 1];; to = [0, 0, 1] => motion.to | another point
~ type = 'circle';; center = [0, 0, 0];; normal = [0, 0, 1];; from = [1, 0, 1] => motion.from | in the plane
~ type = 'circle';; center = [0, 0, 0];; normal = [0, 0, 0];; from = [1, 0, 1] => motion.normal | not zero
@ duration = 0.1;; MOTION
points = [[1]] => motion | unknown key 'points'
goal = ['x'] => motion.goal.0 | got 'x'
duration = 0 => motion.duration | got 0
smooth = 1 => motion.smooth | got 1; allowed: a whole number from 2 to 6
smooth = 4.5 => motion.smooth | got 4.5; allowed: a whole number from 2 to 6, or
smooth = 'minimum_jerk' => motion.smooth | did you mean 'minimum_snap'?
@ duration = 0.1;; [motion];; type = 'via'
points = [[1]];; speed = 1 => motion.points | two or more
~ points = [[1], [2]] => motion | times or speed
~ points = [[1], [2]];; times = [1, 1] => motion.times | increasing
~ points = [[1], [2]];; times = [1] => motion.times | an array of 2 numbers
points = [[1], [2]];; speed = 0 => motion.speed | greater than 0
@ duration = 0.1;; CIRCLE
~ angle = 0 => motion.angle | got 0; allowed: an angle in rad other than 0
~ angle_deg = 0.0 => motion.angle_deg | got 0.0; allowed: an angle in deg other than 0
~ angle_deg = 5e-324 => motion.angle_deg | an angle in deg other than 0
~ angle = 1;; angle_deg = 9 => motion.angle_deg | angle (rad) is given, too
angle_deg = 'x' => motion.angle_deg | got 'x'
@ duration = 0.1;; LINE
orientation = 3 => motion.orientation | 'keep', or a table with from and to
orientation = 'kept' => motion.orientation | did you mean 'keep'
~ orientation = {} => motion.orientation | from, to, or both
~ orientation = { to = [1, 2, 3], to_deg = [1, 2, 3] } => motion.orientation.to_deg | to (rad) is given, too
orientation = { to = [1, 2] } => motion.orientation.to | an array of 3 numbers
@ duration = 0.1;; SPLINE
~ points = [{ xyz = [0, 0, 1], rpy_deg = [9, 0, 0] }, { xyz = [0, 0, 2], rpy = [0, 0, 1], rpy_deg = [9, 0, 0] }] =>
    motion.points[1].rpy_deg | rpy (rad) is given, too
points = [{ xyz = [0, 0, 1] }] => motion.points | two or more
points = [{ xyz = [0, 0, 1] }, { rpy = [0, 0, 1] }] => motion.points[1] | 'xyz' is missing
~ points = [{ xyz = [0, 0, 1] }, { xyz = [0, 0, 1] }] => motion.points[1] | another point
~ points = [{ xyz = [0, 0, 1], rpy = [0, 0, 1] }, { xyz = [0, 0, 2] }] => motion.points[1] | 'rpy' is missing, which
    other points have
~ orientation = 'keep';; points = [{ xyz = [0, 0, 1], rpy = [0, 0, 1] }, { xyz = [0, 0, 2], rpy = [0, 0, 1] }] =>
    motion.orientation | where they have none
@ duration = 0.1;; [control]
type = 'lqr' => control.type | reference, computed_torque, feedforward
type = 'feedforward';; kp = -1 => control.kp | at least 0
type = 'feedforward';; outputs = [] => control.outputs | one or more names such as tcp.x
type = 'feedforward';; tolerance = 0 => control.tolerance | greater than 0
type = 'pd';; kp = 1 => control | the key 'kd' is missing
type = 'pd';; kp = -1;; kd = 1 => control.kp | at least 0
type = 'pd';; kp = { a = -1 };; kd = 1 => control.kp.a | at least 0
type = 'computed_torque';; bandwidth = 0 => control.bandwidth | greater than 0
~ type = 'torque';; rows = [[0, 1]] => control | coordinates with rows
~ type = 'torque';; coordinates = ['a'];; rows = [[0]] => control.rows.0 | array of 2
type = 'torque';; coordinates = ['a'];; rows = [] => control.rows | no rows
~ type = 'torque';; coordinates = ['a'];; rows = [[1, 1], [0, 1]] => control.rows.1 | got the time 0 after 1
@ duration = 0.1;; SHAKEN
~ phase = 1;; phase_deg = 9 => prescribed[0].phase_deg | phase (rad) is given, too
@ duration = 0.1;; [[wrenches]]
~ link = 'a' => wrenches[0] | needs force and/or moment
force = [1, 2, 3] => wrenches[0] | 'link' is missing
link = 'a';; force = [1, 2] => wrenches[0].force | array of 3
link = 'a';; force = [1, 2, 3];; axes = 'tool' => wrenches[0].axes | base, link
~ link = 'a';; force = [1, 2, 3];; t0 = 2;; t1 = 1 => wrenches[0].t1 | after t0
@ duration = 0.1;; [[payloads]]
link = 'a';; point = [0, 0, 0];; mass = 0 => payloads[0].mass | greater than 0
link = 'a';; mass = 1 => payloads[0] | 'point' is missing
~ link = 'a';; mass = 1;; point = [0, 0, 0];; inertia = { xx = 1, yy = 1, zz = 5 } => payloads[0].inertia | no body
    can have
"""

PLANS = r"""
samples = 2 => the key 'vary' is missing
vary = 3 => vary | 3 | [[vary]]
vary = [] => vary | one or more
sample = 2;; STIFF;; UNIFORM => unknown key 'sample'; did you mean 'samples'
~ STIFF;; UNIFORM => the key 'samples' is missing
samples = 0;; STIFF;; UNIFORM => samples | 0 | from 1
samples = 2.5;; STIFF;; UNIFORM => samples | 2.5 | whole number
~ samples = 2;; STIFF;; GRID => samples | grids alone
samples = 2;; seed = -1;; STIFF;; UNIFORM => seed | -1 | from 0
samples = 2;; design = 'sobol';; STIFF;; UNIFORM => design | sobol | latin_hypercube
record = [];; STIFF;; GRID => record | one or more
record = ['tool_deviation'];; STIFF;; GRID => record | tool_deviation | did you mean
[engine];; type = 'gpu';; STIFF;; GRID => engine.type | gpu | rollout
[engine];; method = 'rk4';; STIFF;; GRID => engine.method | [integrator]
[engine];; step = 1e-3;; STIFF;; GRID => engine.step | rtol
[engine];; type = 'rollout';; period = 1e-3;; STIFF;; GRID => engine.period | [integrator]
[engine];; steps = 3;; STIFF;; GRID => engine | unknown key | type
~ [[vary]];; GRID => vary[0] | parameter or scenario
~ [[vary]];; parameter = 'gravity.x';; scenario = 'duration';; GRID => vary[0] | one of them
~ STIFF => vary[0] | one distribution | none
~ samples = 2;; STIFF;; UNIFORM;; GRID => vary[0] | grid, uniform
~ samples = 2;; STIFF;; uniform = { low = 2.0, high = 2.0 } => vary[0].uniform.high | greater than low
samples = 2;; STIFF;; uniform = { low = 2.0 } => vary[0].uniform | 'high' is missing
samples = 2;; STIFF;; normal = { mean = 2.0, deviation = 0.0 } => vary[0].normal.deviation | greater than 0
~ samples = 2;; STIFF;; normal = { mean = 0.0, deviation = 1.0, low = 9.0 } => vary[0].normal.low | 8 deviations
STIFF;; grid = { values = [1.0, 'a'] } => vary[0].grid.values.1 | 'a' | finite number
~ STIFF;; grid = { values = [1.0, 1.0] } => vary[0].grid.values | different
~ STIFF;; grid = { values = [1.0], count = 3 } => vary[0].grid.count | values, or low
STIFF;; grid = { low = 1.0, high = 2.0, count = 1 } => vary[0].grid.count | from 2
~ STIFF;; GRID;; STIFF;; GRID => vary[1] | vary[0] | once
"""

CURVES = r"""
0,1,2;; 1,2,3 => joints.joint1.x.curve | line 1 | '0,1,2' | deviation,force
s,F;; 0,1;; 1,two => joints.joint1.x.curve | line 3 | '1,two'
s,F;; m,N;; 0,1 => | line 2 | 'm,N'
0,nan;; 1,1 => joints.joint1.x.curve.0.1 | nan | finite
s,F => joints.joint1.x.curve | 0 points | 2 to 64
0,1;; -1,2 => joints.joint1.x.curve | point 1 | -1.0 after 0.0
"""

MOTIONS = r"""
0,1_0 => line 2: | '1_0'; allowed: a finite number
0,0x10 => line 2: | '0x10'
0, => line 2: | ''; allowed: a finite number
0,1 # no comment => line 2: | '1 # no comment'
0,"1 => line 2: | a quote is not closed
0,"1;; 1,2" => line 2: | a quote is not closed
0,1e999 => line 2: | '1e999'
0,1, => line 2: | 3 values; allowed: 2
<  *1> => line 2: | 1 values; allowed: 2
0,<1*200000> => line 2: | field larger than field limit
"""
