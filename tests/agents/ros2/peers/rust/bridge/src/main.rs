//! A bridge from ROS 2 on DDS to Zenoh: the published plugin, in a process of its own.
//! bridge ENDPOINT [JSON5 of the plugin]: it listens at the endpoint, as a router.
use zenoh::internal::{plugins::PluginsManager, runtime::RuntimeBuilder};
use zenoh_plugin_ros2dds::ROS2Plugin;

#[tokio::main]
async fn main() -> zenoh::Result<()> {
    zenoh::init_log_from_env_or("warn");
    let mut arguments = std::env::args().skip(1);
    let endpoint = arguments.next().expect("an endpoint such as tcp/127.0.0.1:7447");
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"router\"")?;
    config.insert_json5("listen/endpoints", &format!("[{endpoint:?}]"))?;
    config.insert_json5("scouting/multicast/enabled", "false")?;
    config.insert_json5("plugins/ros2dds", &arguments.next().unwrap_or("{}".into()))?;
    let mut plugins = PluginsManager::static_plugins_only();
    plugins.declare_static_plugin::<ROS2Plugin, &str>("ros2dds", true);
    let mut runtime = RuntimeBuilder::new(config).plugins_manager(plugins).build().await?;
    runtime.start().await?;
    println!("{{\"ready\": \"bridge\"}}");
    tokio::signal::ctrl_c().await?;
    Ok(())
}
