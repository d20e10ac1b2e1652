{{- define "lf.name" -}}
{{- if contains .Chart.Name .Release.Name }}{{ .Release.Name | trunc 40 | trimSuffix "-" }}
{{- else }}{{ printf "%s-%s" .Release.Name .Chart.Name | trunc 40 | trimSuffix "-" }}{{ end }}
{{- end }}

{{/* Labels that select pods: (dict "root" $ "part" "gateway"). */}}
{{- define "lf.selector" -}}
app.kubernetes.io/name: {{ .root.Chart.Name }}
app.kubernetes.io/instance: {{ .root.Release.Name }}
app.kubernetes.io/component: {{ .part }}
{{- end }}

{{- define "lf.labels" -}}
{{ include "lf.selector" . }}
app.kubernetes.io/version: {{ .root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .root.Release.Service }}
helm.sh/chart: {{ printf "%s-%s" .root.Chart.Name .root.Chart.Version }}
{{- end }}

{{/* Image: (dict "root" $ "image" .Values.images.gateway). */}}
{{- define "lf.image" -}}
{{ .image.repository }}:{{ .image.tag | default .root.Chart.AppVersion }}
{{- end }}

{{- define "lf.protocol" -}}
{{ ternary "tls" "tcp" .Values.zenoh.tls.enabled }}
{{- end }}

{{/* Names by which the routers are reached in the cluster: of the service, and of each router. */}}
{{- define "lf.routerService" -}}
{{ include "lf.name" . }}-routers.{{ .Release.Namespace }}.svc
{{- end }}
{{- define "lf.routerHost" -}}
{{ $name := include "lf.name" .root }}
{{- $name }}-router-{{ .number }}.{{ $name }}-router-peers.{{ .root.Release.Namespace }}.svc
{{- end }}
{{- define "lf.routerHosts" -}}
{{- $hosts := list (include "lf.routerService" .) }}
{{- range until (int .Values.zenoh.replicas) }}{{ $hosts = append $hosts (include "lf.routerHost" (dict "root" $ "number" .)) }}{{ end }}
{{- join "," $hosts }}
{{- end }}

{{/* Endpoints of all routers: a gateway is linked to each. */}}
{{- define "lf.routerEndpoints" -}}
{{- $found := list }}
{{- range until (int .Values.zenoh.replicas) }}
{{- $found = append $found (printf "%s/%s:7447" (include "lf.protocol" $) (include "lf.routerHost" (dict "root" $ "number" .))) }}
{{- end }}
{{- join "," $found }}
{{- end }}
