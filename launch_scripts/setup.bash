# Makes musselbed's messages known to rostopic, rosmsg, rosservice, rosbag and roslaunch, and `musselbed` to the shell.
# Use: source launch_scripts/setup.bash     (bash; as often as you like)
#
# Everything goes to the END of its list: a workspace that was sourced before keeps its own auv_msgs and its own python3.
_musselbed_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
_musselbed_messages=$_musselbed_root/.venv/share/musselbed/ros

# $1: the name of a list, $2: the entry to add
_musselbed_append() {
  local list=${!1:-}
  case ":$list:" in
    *":$2:"*) ;;
    *) export "$1=${list:+$list:}$2" ;;
  esac
}

if [ -d "$_musselbed_messages" ]; then
  # Debian's tools run /usr/bin/python3: they search code on PYTHONPATH and definitions on ROS_PACKAGE_PATH, nowhere else.
  _musselbed_append PYTHONPATH "$_musselbed_messages"
  _musselbed_append ROS_PACKAGE_PATH "$_musselbed_messages"
  _musselbed_append ROS_PACKAGE_PATH "$_musselbed_root/launch_scripts"
  # rosnodejs ends with an error where this list is empty. It reads definitions on ROS_PACKAGE_PATH; nothing here is built.
  _musselbed_append CMAKE_PREFIX_PATH "$_musselbed_root/.venv"
  _musselbed_append PATH "$_musselbed_root/.venv/bin"
  unset -f _musselbed_append
  unset _musselbed_root _musselbed_messages
else
  echo "musselbed: nothing is installed in $_musselbed_root yet: run launch_scripts/install, then source this again" >&2
  unset -f _musselbed_append
  unset _musselbed_root _musselbed_messages
  return 1
fi
